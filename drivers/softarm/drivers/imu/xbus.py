"""Xbus messages of Xsens units: `FA FF MID LEN data CS`, big-endian; orientation comes in MTData2 (0x36)."""

import struct
from dataclasses import dataclass
from typing import Final

from softarm.drivers.framing import FrameFault, FrameParser, checksum8
from softarm.drivers.imu.sample import ImuSample, normalised

GO_TO_CONFIG: Final = 0x30
GO_TO_MEASUREMENT: Final = 0x10
MT_DATA2: Final = 0x36
WAKE_UP: Final = 0x3E
ERROR: Final = 0x42
INDEX_MODULUS: Final = 65536
TICK: Final = 1e-4
"""One step [s] of the sample time."""

TIME_MODULUS: Final = 2**32 * TICK
"""Where the sample time [s] starts again."""

_LONGEST: Final = 2048
_PACKET_COUNTER: Final = 0x1020
_SAMPLE_TIME_FINE: Final = 0x1060
_QUATERNION: Final = 0x2010
_ACCELERATION: Final = 0x4020


@dataclass(frozen=True, slots=True)
class XbusMessage:
    """A message that is no orientation: an acknowledgement, a wake-up, an error."""

    message_id: int
    data: bytes


class XbusRule:
    """One message; lengths of 255 and more stand in two further bytes."""

    start = b"\xfa\xff"

    def length(self, head: bytes) -> int | None:
        """Return the length of the whole message."""
        if len(head) < 4:
            return None
        if head[3] != 0xFF:
            return 5 + head[3]
        if len(head) < 6:
            return None
        extended = int.from_bytes(head[4:6], "big")
        # A shorter message has no need of the extended length: such bytes only look like a header.
        return 7 + extended if 255 <= extended <= _LONGEST else 0

    def decode(self, frame: bytes) -> ImuSample | XbusMessage | FrameFault:
        """Return the orientation or the message, or the fault that makes it none."""
        # The checksum makes all bytes after the preamble sum to zero.
        if checksum8(frame[1:]):
            return FrameFault("checksum", f"the sum is {checksum8(frame[1:]):#04x} instead of 0")
        data = frame[6:-1] if frame[3] == 0xFF else frame[4:-1]
        return _mt_data2(data) if frame[2] == MT_DATA2 else XbusMessage(frame[2], data)


def xbus_codec() -> FrameParser[ImuSample | XbusMessage]:
    """Return a new parser of the stream."""
    return FrameParser(XbusRule(), head=6)


def encode_message(message_id: int, data: bytes = b"") -> bytes:
    """Return the bytes of a message of at most 254 data bytes."""
    if len(data) > 254:
        raise ValueError(f"an Xbus message of {len(data)} bytes needs the extended length; at most 254 here")
    body = bytes([0xFF, message_id, len(data)]) + data
    return b"\xfa" + body + bytes([-sum(body) & 0xFF])


def _mt_data2(data: bytes) -> ImuSample | FrameFault:
    """Read the groups `u16 id, u8 length, data`; unknown ones are passed over."""
    groups: dict[int, bytes] = {}
    at = 0
    while at + 3 <= len(data):
        group, length = struct.unpack_from(">HB", data, at)
        at += 3 + length
        # The low four bits of an identifier state how its data are coded, not what they are.
        groups[group & 0xFFF0] = data[at - length : at] + bytes([group & 0x0F])
    if at != len(data):
        return FrameFault("framing", "a group of MTData2 is longer than its message")
    return _sample(groups)


def _sample(groups: dict[int, bytes]) -> ImuSample | FrameFault:
    """Assemble one orientation; each group carries its format (precision, axes) in a last byte."""
    values = _floats(groups.get(_QUATERNION, b""), 4)
    if values is None:
        return FrameFault(
            "content", "MTData2 without an orientation quaternion in single or double precision"
        )
    quaternion = normalised(values[0], values[1], values[2], values[3], 0.01)
    if quaternion is None:
        return FrameFault("range", "the quaternion is not of unit length")
    counter, ticks = groups.get(_PACKET_COUNTER, b""), groups.get(_SAMPLE_TIME_FINE, b"")
    acceleration = _floats(groups.get(_ACCELERATION, b""), 3)
    return ImuSample(
        quaternion,
        index=int.from_bytes(counter[:2], "big") if len(counter) == 3 else None,
        device_time=int.from_bytes(ticks[:4], "big") * TICK if len(ticks) == 5 else None,
        acceleration=(acceleration[0], acceleration[1], acceleration[2]) if acceleration else None,
    )


def _floats(group: bytes, count: int) -> tuple[float, ...] | None:
    """Return `count` numbers of a group in single (format 0) or double precision (format 3), or None."""
    formats = {0: ("f", 4), 3: ("d", 8)}
    code, size = formats.get(group[-1] & 0x03, ("", 0)) if group else ("", 0)
    if not size or len(group) != count * size + 1:
        return None
    return struct.unpack_from(f">{count}{code}", group)
