"""Replies of a Mark-10 gauge that speaks GCL2 (Series 4 and 5 manuals): CRLF lines, polled with `?`."""

import re
from dataclasses import dataclass
from typing import Final

from softarm.drivers.framing import FrameFault, LineCodec, LineParser
from softarm.drivers.gauges.sample import GaugeSample, unit_named

READ: Final = b"?\r\n"
LIST: Final = b"LIST\r\n"

_READING: Final = re.compile(rb"([+-]?)(\d{1,9})(?:\.(\d{0,6}))?(?:\s+([A-Za-z]{1,4}))?")
_OVERLOAD: Final = re.compile(rb"-{3,9}(?:\s+[A-Za-z]{1,4})?")
_ERRORS: Final = {
    b"*10": "illegal command",
    b"*11": "command does not apply",
    b"*12": "invalid specifier",
    b"*22": "value too large",
}


@dataclass(frozen=True, slots=True)
class Mark10Settings:
    """The reply to `LIST`: firmware first, battery last.

    Args:
        fields: All fields in the order of the reply, in capitals.
    """

    fields: tuple[str, ...]

    @property
    def unit(self) -> str | None:
        """The unit that the gauge is set to, a key of `NEWTON_PER`."""
        return next((unit for unit in map(unit_named, self.fields[1:-1]) if unit), None)

    @property
    def shows_peak(self) -> bool:
        """Whether a reading is the peak of a pull or a push, and not the present force."""
        return "PT" in self.fields or "PC" in self.fields

    @property
    def sends_polarity(self) -> bool:
        """Whether readings carry their sign, negative for tension; false when it is inverted or omitted."""
        return "POL" in self.fields


@dataclass(frozen=True, slots=True)
class Mark10Error:
    """An error reply, such as `*10`.

    Args:
        code: The reply.
        meaning: Its meaning in the manual.
    """

    code: str
    meaning: str


Mark10Reply = GaugeSample | Mark10Settings | Mark10Error


def mark10_codec() -> LineCodec[Mark10Reply]:
    """Return a new parser of replies, polled or continuous."""
    # A gauge that is polled sends whole replies, so the first line is complete.
    return LineCodec(parse_reply, LineParser(longest=160, discard_first=False))


def parse_reply(line: bytes) -> Mark10Reply | FrameFault:
    """Decode one line, without its end."""
    text = line.strip()
    if text in _ERRORS:
        return Mark10Error(text.decode("ascii"), _ERRORS[text])
    if text.count(b";") >= 3 and text.isascii():
        return Mark10Settings(tuple(part.strip().upper() for part in text.decode("ascii").split(";")))
    if _OVERLOAD.fullmatch(text):
        return GaugeSample(0.0, None, 0, over_range=True)
    match = _READING.fullmatch(text)
    if match is None:
        return FrameFault("text", f"neither a reading nor a reply: {text[:40]!r}")
    sign, whole, fraction, unit = match.groups()
    key = unit_named(unit.decode("ascii")) if unit else None
    if unit and key is None:
        return FrameFault("unit", f"unit {unit!r} is not a unit of force gauges")
    value = float(whole + b"." + (fraction or b"0"))
    return GaugeSample(-value if sign == b"-" else value, key, len(fraction or b""))
