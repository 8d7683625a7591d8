"""A sample of any force gauge: a number, its unit, and whether it may be used."""

from dataclasses import dataclass
from typing import Final

NEWTON_PER: Final[dict[str, float]] = {
    "N": 1.0,
    "mN": 1e-3,
    "kN": 1e3,
    "g": 9.80665e-3,
    "kg": 9.80665,
    "tf": 9806.65,
    "lb": 4.4482216152605,
    "klb": 4448.2216152605,
    "oz": 0.27801385095378125,
}
"""Newtons per unit that a gauge can show; mass units are their weight under standard gravity."""

_SPELLINGS: Final[dict[str, str]] = {
    "n": "N",
    "mn": "mN",
    "kn": "kN",
    "g": "g",
    "gf": "g",
    "kg": "kg",
    "kgf": "kg",
    "lb": "lb",
    "lbf": "lb",
    "oz": "oz",
    "ozf": "oz",
    "tf": "tf",
    "klbf": "klb",
}


def unit_named(text: str) -> str | None:
    """Return the key of `NEWTON_PER` for a unit as instruments spell it, or None."""
    return _SPELLINGS.get(text.strip().lower())


def shows_overload(digits: bytes) -> bool:
    """Return whether the digits are all nines, which is how a display shows an overload.

    At least four are required: 9, 99 and 999 are ordinary weights in grams.
    """
    return len(digits) >= 4 and not digits.strip(b"9")


@dataclass(frozen=True, slots=True)
class GaugeSample:
    """One reading of a force gauge, as the instrument sent it.

    Args:
        value: The number with its sign, in `unit`.
        unit: A key of `NEWTON_PER`, or None if the protocol does not carry it.
        decimals: Digits after the decimal point: the resolution that the operator has set.
        over_range: The instrument reports that it cannot measure this load; the value is meaningless.
        stable: Whether a balance reports that it has settled; None if the protocol does not carry it.
        display: 1 for the main display, 2 for a second one.
    """

    value: float
    unit: str | None
    decimals: int
    over_range: bool = False
    stable: bool | None = None
    display: int = 1
