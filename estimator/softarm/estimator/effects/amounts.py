"""Quantities as people read them: degrees, millimetres, grams and kilopascals instead of SI units."""

from dataclasses import dataclass

import numpy as np

READABLE: dict[str, tuple[float, str]] = {
    "1": (1.0, ""),
    "rad": (180.0 / np.pi, "degrees"),
    "m": (1e3, "mm"),
    "Pa": (1e-3, "kPa"),
    "kg": (1e3, "g"),
    "rad/Pa": (180e3 / np.pi, "degrees per kPa"),
    "rad/s": (180.0 * 60.0 / np.pi, "degrees per minute"),
    "m/s": (60e3, "mm per minute"),
    "rad/(N m)": (180.0 / np.pi, "degrees per N m"),
    "1/rad2": (1.0, "per square radian"),
    "Pa/s": (1e-3, "kPa/s"),
}
"""Factor and name of the unit in which people read a quantity, by its SI unit."""


def readable(unit: str) -> tuple[float, str]:
    """Return the factor to, and the name of, the unit in which people read a quantity in an SI unit."""
    return READABLE.get(unit, (1.0, unit))


@dataclass(frozen=True)
class Amount:
    """A value that prints itself in the unit in which people read it.

    In a format string ``{mass}`` prints the value with its unit, ``{force_x:number}`` the number alone,
    ``{share:percent}`` the value in percent, and ``{gain:lower|higher}`` its size, of a ratio in percent,
    followed by the first words where it is negative and by the second where it is not; ``{relaxed:=at once|in
    the end}`` prints the first words for 0 and the second for any other value.

    Args:
        value: In the SI unit.
        unit: The SI unit, ``1`` for none.
    """

    value: float
    unit: str

    def __format__(self, form: str) -> str:
        """Return the value as text; see the class."""
        if form == "percent":
            return f"{100.0 * self.value:.3g} %"
        if form == "number":
            return f"{readable(self.unit)[0] * self.value:.3g}"
        if form.startswith("="):
            return form[1:].split("|")[self.value != 0.0]
        factor, name = readable(self.unit)
        if form:
            if self.unit == "1":
                factor, name = 100.0, "%"
            negative, _, positive = form.partition("|")
            return f"{factor * abs(self.value):.3g} {name} {negative if self.value < 0.0 else positive}"
        return f"{factor * self.value:.3g} {name}".strip()
