"""Packets of the QTM RT protocol, little endian (Qualisys' documentation of it)."""

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass

ERROR, COMMAND, XML, DATA, NO_MORE_DATA, EVENT, DISCOVER = 0, 1, 2, 3, 4, 6, 7

HEADER = struct.Struct("<II")
FRAME_HEADER = struct.Struct("<qII")
COMPONENT_HEADER = struct.Struct("<IIIhh")

Matrix = tuple[float, ...]


@dataclass(frozen=True)
class PacketBody:
    """One body of a frame.

    Args:
        position: Origin [mm].
        rotation: Rotation matrix by columns, nine numbers.
        residual: Residual of the fit [mm].
    """

    position: tuple[float, float, float]
    rotation: Matrix
    residual: float


@dataclass(frozen=True)
class MeasuredFrame:
    """One frame of a measurement.

    Args:
        time_us: Microseconds since the measurement began.
        number: Frame number, from 1.
        bodies: Poses in the order of the settings; None for a lost body.
        drop_rate: Share of dropped camera frames [per mille].
        out_of_sync: Share of camera frames out of step [per mille].
    """

    time_us: int
    number: int
    bodies: Sequence[PacketBody | None]
    drop_rate: int = 0
    out_of_sync: int = 0


def packet(kind: int, payload: bytes = b"") -> bytes:
    """Put the header before a payload."""
    return HEADER.pack(HEADER.size + len(payload), kind) + payload


def text(kind: int, words: str) -> bytes:
    """Make an error, command or XML packet."""
    return packet(kind, words.encode() + b"\0")


def event(number: int) -> bytes:
    """Make an event packet."""
    return packet(EVENT, bytes([number]))


def _pose_6d(body: PacketBody) -> tuple[float, ...]:
    return (*body.position, *body.rotation)


def _pose_6d_residual(body: PacketBody) -> tuple[float, ...]:
    return (*body.position, *body.rotation, body.residual)


def _pose_euler(body: PacketBody) -> tuple[float, ...]:
    return (*body.position, *euler_angles(body.rotation))


def _pose_euler_residual(body: PacketBody) -> tuple[float, ...]:
    return (*body.position, *euler_angles(body.rotation), body.residual)


COMPONENTS: dict[str, tuple[int, int, Callable[[PacketBody], tuple[float, ...]]]] = {
    "6d": (5, 12, _pose_6d),
    "6deuler": (6, 6, _pose_euler),
    "6dres": (11, 13, _pose_6d_residual),
    "6deulerres": (12, 7, _pose_euler_residual),
}
TIMECODE = "timecode"
TIMECODE_TYPE = 17


def data_packet(frame: MeasuredFrame, components: Sequence[str]) -> bytes:
    """Make a data packet.

    Args:
        frame: What was measured.
        components: Keys of ``COMPONENTS`` or ``TIMECODE``.
    """
    parts = [_timecode(frame) if name == TIMECODE else _component(frame, name) for name in components]
    return packet(DATA, FRAME_HEADER.pack(frame.time_us, frame.number, len(parts)) + b"".join(parts))


def _component(frame: MeasuredFrame, name: str) -> bytes:
    kind, floats, fields = COMPONENTS[name]
    layout = struct.Struct(f"<{floats}f")
    lost = b"\xff" * layout.size  # packing NaN would yield another bit pattern than QTM's
    bodies = b"".join(lost if body is None else layout.pack(*fields(body)) for body in frame.bodies)
    head = COMPONENT_HEADER.pack(
        COMPONENT_HEADER.size + len(bodies), kind, len(frame.bodies), frame.drop_rate, frame.out_of_sync
    )
    return head + bodies


def _timecode(frame: MeasuredFrame) -> bytes:
    """Make a camera-time code: type 2, high and low word in 100 ns ticks."""
    ticks = frame.time_us * 10
    return struct.pack("<IIIIII", 24, TIMECODE_TYPE, 1, 2, ticks >> 32, ticks & 0xFFFFFFFF)


def euler_angles(rotation: Matrix) -> tuple[float, float, float]:
    """Return roll, pitch, yaw [degrees] of R = Rx(roll) Ry(pitch) Rz(yaw), QTM's own choice."""
    r00, r01, r02 = rotation[0], rotation[3], rotation[6]
    r12, r22 = rotation[7], rotation[8]
    pitch = math.asin(max(-1.0, min(1.0, r02)))
    return math.degrees(math.atan2(-r12, r22)), math.degrees(pitch), math.degrees(math.atan2(-r01, r00))
