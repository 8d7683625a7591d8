"""The lab's Arduino line for BendLabs sensors: `x1,y1,x2,y2,x3,y3`, degrees, sensor 1 at the far end.

The Arduino library freezes its output until it has moved by 0.5 degrees, so equal lines are the rule and no
sign of a fault; the line carries neither sequence nor time. A sensor that drops out later repeats its last
value silently.
"""

import re
from dataclasses import dataclass
from typing import Final

from softarm.drivers.framing import FrameFault, LineCodec, LineParser

_ANGLE: Final = re.compile(r"[+-]?\d{1,4}(?:\.\d{0,6})?")
_ABSENT: Final = re.compile(r"cannot connect to sensor\s*(\d+)", re.IGNORECASE)
_LIMIT_DEG: Final = 360.0


@dataclass(frozen=True, slots=True)
class BendLine:
    """One line of angles, in the order of the wire.

    Args:
        angles_deg: Two angles per sensor [degree], x1, y1, x2, y2, ...
    """

    angles_deg: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class BendStatus:
    """A line of text: the sketch has started or complains.

    Args:
        text: The line.
        absent_sensor: The number of the sensor (1 at the far end) that cannot be reached, or None.
    """

    text: str
    absent_sensor: int | None


def bend_codec(sensors: int = 3) -> LineCodec[BendLine | BendStatus]:
    """Return a new parser of lines that carry so many sensors."""
    return LineCodec(lambda line: parse_line(line, sensors), LineParser(), absent_sensor)


def absent_sensor(line: bytes) -> BendStatus | None:
    """Return the complaint about a sensor in a line that may lack its beginning, such as the first of all."""
    absent = _ABSENT.search(line.decode("ascii", errors="replace"))
    return BendStatus(absent[0], int(absent[1])) if absent else None


def parse_line(line: bytes, sensors: int = 3) -> BendLine | BendStatus | FrameFault:
    """Decode one line, without its end."""
    if not line.isascii() or not (text := line.decode("ascii").strip()).isprintable():
        return FrameFault("text", f"bytes that are not text: {line[:40]!r}")
    fields = [part.strip() for part in text.split(",")]
    if len(fields) == 1 and re.search(r"[A-Za-z]{3}", text) and text.lower() not in ("nan", "inf", "ovf"):
        absent = _ABSENT.search(text)
        return BendStatus(text, int(absent[1]) if absent else None)
    if len(fields) != 2 * sensors:
        return FrameFault("fields", f"{len(fields)} values in a line, {2 * sensors} expected: {text[:60]!r}")
    if not all(_ANGLE.fullmatch(part) for part in fields):
        return FrameFault("value", f"a value that is not an angle: {text[:60]!r}")
    angles = tuple(float(part) for part in fields)
    if max(map(abs, angles)) > _LIMIT_DEG:
        return FrameFault("range", f"an angle beyond {_LIMIT_DEG:.0f} degrees: {text[:60]!r}")
    return BendLine(angles)
