"""The 16-digit stream of Lutron instruments (FG-6005SD manual, p. 29): 9600 8N1, output only, no checksum."""

from typing import Final

from softarm.drivers.framing import FrameFault, FrameParser
from softarm.drivers.gauges.sample import GaugeSample, shows_overload

FRAME_LENGTH: Final = 16
_START: Final = 0x02
_END: Final = 0x0D
_UNITS: Final = {b"55": "kg", b"56": "lb", b"57": "g", b"58": "oz", b"59": "N"}


class LutronRule:
    """One frame: 0x02, '4', display, unit (2), polarity, decimals, eight digits, 0x0D."""

    start = bytes([_START])

    def length(self, head: bytes) -> int | None:
        """Return 16: every frame has the same length."""
        return FRAME_LENGTH if head else None

    def decode(self, frame: bytes) -> GaugeSample | FrameFault:
        """Return the reading, or the fault that makes it none."""
        display, unit, polarity, decimals = frame[2] - 0x30, frame[3:5], frame[5] - 0x30, frame[6] - 0x30
        digits = frame[7:15]
        if frame[1] != 0x34 or frame[15] != _END or display not in (1, 2):
            return FrameFault("framing", f"not a Lutron frame: {frame.hex(' ')}")
        if polarity not in (0, 1) or decimals not in (0, 1, 2, 3) or not digits.isdigit():
            return FrameFault("digits", f"unexpected character in a Lutron reading: {frame.hex(' ')}")
        if unit not in _UNITS:
            return FrameFault("unit", f"unit code {unit!r} is not one of kg, lb, g, oz, N")
        value = int(digits) / 10**decimals
        signed = -value if polarity else value
        # The reading fills the eight digits from the right: leading zeros are those that the display lacks.
        overload = shows_overload(digits.lstrip(b"0"))
        return GaugeSample(signed, _UNITS[unit], decimals, overload, display=display)


def lutron_codec() -> FrameParser[GaugeSample]:
    """Return a new parser of the stream."""
    return FrameParser(LutronRule(), head=1)
