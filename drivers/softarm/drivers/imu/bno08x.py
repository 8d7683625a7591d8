"""UART-RVC frames of a BNO080 or BNO085 (BNO080 datasheet, page 21): 115200 8N1, 100 Hz, output only."""

import struct
from typing import Final

from softarm.drivers.framing import FrameFault, FrameParser, checksum8
from softarm.drivers.imu.sample import ImuSample, quaternion_from_yaw_pitch_roll

FRAME_LENGTH: Final = 19
INDEX_MODULUS: Final = 256

_BODY: Final = struct.Struct("<B6h")
_MILLI_G: Final = 9.80665e-3


class RvcRule:
    """One frame: AA AA, index, yaw, pitch, roll [0.01 degree], acceleration [mg], three reserved, sum."""

    start = b"\xaa\xaa"

    def length(self, head: bytes) -> int | None:
        """Return 19: every frame has the same length."""
        return FRAME_LENGTH if head else None

    def decode(self, frame: bytes) -> ImuSample | FrameFault:
        """Return the orientation, or the fault that makes it none."""
        # AA AA may also stand inside a frame: only the sum identifies a header, so a failure costs one byte.
        if checksum8(frame[2:18]) != frame[18]:
            return FrameFault("checksum", f"sum {checksum8(frame[2:18]):#04x}, frame says {frame[18]:#04x}")
        index, yaw, pitch, roll, *acceleration = _BODY.unpack_from(frame, 2)
        if abs(yaw) > 18000 or abs(pitch) > 9000 or abs(roll) > 18000:
            return FrameFault("range", f"yaw {yaw}, pitch {pitch}, roll {roll} in 0.01 degree")
        ax, ay, az = (value * _MILLI_G for value in acceleration)
        quaternion = quaternion_from_yaw_pitch_roll(yaw / 100, pitch / 100, roll / 100)
        return ImuSample(quaternion, index, acceleration=(ax, ay, az))


def bno08x_codec() -> FrameParser[ImuSample]:
    """Return a new parser of the stream."""
    return FrameParser(RvcRule(), head=1)
