"""A plain line protocol: one reading per line, as HX711 boards, balances and home-made sketches print it.

It accepts a number with or without a unit (`1.234`, `-12.5 g`), the same among separated columns, the
stability words of balances (`S S 100.00 g`, `S D`, `ST,GS,+0012.3 g`, `US,NT,...`) and their overload words
(`S +`, `S -`).
"""

import re
from typing import Final

from softarm.drivers.framing import FrameFault, LineCodec
from softarm.drivers.gauges.sample import GaugeSample, unit_named

_NUMBER: Final = re.compile(r"([+-]?)\s*(\d{1,12})(?:\.(\d{0,9}))?\s*([A-Za-z]{1,4})?")
_BALANCE: Final = re.compile(r"S\s+([SDI+-])(?:\s+(.*))?|(ST|US|OL),(?:GS|NT|TR),?\s*(.*)")


def line_gauge_codec(separator: str | None = None, column: int = 0) -> LineCodec[GaugeSample]:
    """Return a new parser of reading lines.

    Args:
        separator: What separates columns; None if a line is one reading.
        column: Which column is the reading, counted from 0.
    """
    return LineCodec(lambda line: parse_line(line, separator, column))


def parse_line(line: bytes, separator: str | None = None, column: int = 0) -> GaugeSample | FrameFault:
    """Return the reading in one line, without its end."""
    if not line.isascii():
        return FrameFault("text", f"bytes that are not text: {line[:40]!r}")
    text = line.decode("ascii").strip()
    balance = _BALANCE.fullmatch(text)
    if balance:
        return _balance(balance[1] or balance[3], balance[2] or balance[4] or "")
    if separator is not None:
        columns = text.split(separator)
        if column >= len(columns):
            return FrameFault("columns", f"{len(columns)} columns, the reading is in column {column}")
        text = columns[column].strip()
    return _number(text, None)


def _balance(word: str, rest: str) -> GaugeSample | FrameFault:
    if word in ("+", "-", "OL"):
        return GaugeSample(0.0, None, 0, over_range=True)
    if word == "I":
        return FrameFault("busy", "the balance cannot answer now")
    return _number(rest.strip(), stable=word in ("S", "ST"))


def _number(text: str, stable: bool | None) -> GaugeSample | FrameFault:
    match = _NUMBER.fullmatch(text)
    if match is None:
        return FrameFault("text", f"not a reading: {text[:40]!r}")
    sign, whole, fraction, unit = match.groups()
    key = unit_named(unit) if unit else None
    if unit and key is None:
        return FrameFault("unit", f"unit {unit!r} is not a unit of force gauges")
    value = float(f"{whole}.{fraction or 0}")
    return GaugeSample(-value if sign == "-" else value, key, len(fraction or ""), stable=stable)
