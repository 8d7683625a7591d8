"""The lab's quaternion line, `Quaternion of IMU 1:w,x,y,z`, two decimals, 9600 baud, below 10 Hz."""

import re
from typing import Final

from softarm.drivers.framing import FrameFault, LineCodec
from softarm.drivers.imu.sample import ImuSample, normalised

LENGTH_TOLERANCE: Final = 0.03
"""Four numbers rounded to two decimals are off unit length by at most about 0.01; more is not a rotation."""

_LINE: Final = re.compile(r"Quaternion of IMU\s*(\d{1,2})\s*:\s*(.*)")
_NUMBER: Final = re.compile(r"[+-]?\d(?:\.\d{0,8})?")


def quaternion_line_codec() -> LineCodec[ImuSample]:
    """Return a new parser of the lines; other text is a `text` fault."""
    return LineCodec(parse_line)


def parse_line(line: bytes) -> ImuSample | FrameFault:
    """Return the orientation in one line, without its end."""
    match = _LINE.fullmatch(line.decode("ascii", errors="replace").strip())
    if match is None:
        return FrameFault("text", f"not a quaternion line: {line[:40]!r}")
    parts = [part.strip() for part in match[2].split(",")]
    if len(parts) != 4 or not all(_NUMBER.fullmatch(part) for part in parts):
        return FrameFault("value", f"not four numbers: {match[2][:40]!r}")
    w, x, y, z = (float(part) for part in parts)
    quaternion = normalised(w, x, y, z, LENGTH_TOLERANCE)
    if quaternion is None:
        return FrameFault("range", f"not of unit length: {match[2][:40]!r}")
    return ImuSample(quaternion, unit=int(match[1]))
