"""A valve that does not open for the first bit of its set-point."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.effects.effect import EffectParameter, Filter, InstrumentEffect, Numbers, Where
from softarm.fakes.plant.effects.instrument.masks import chamber_mask


@dataclass(frozen=True)
class Deadband:
    """Return zero up to a width, and that much less above."""

    width: float
    mask: NDArray[np.bool_]

    def update(self, time: float, value: Floats) -> Floats:  # noqa: ARG002
        """Pass the pressures through [Pa]."""
        return np.where(self.mask[: len(value)], np.maximum(0.0, value - self.width), value)


def make(signal: str, where: Where, numbers: Numbers) -> Filter:  # noqa: ARG001
    """Make the filter of the valves."""
    return Deadband(numbers["width"], chamber_mask(where))


EFFECT = InstrumentEffect(
    "valve_deadband",
    "width",
    {"width": EffectParameter("Pa", 3e3, 1e3, 6e3)},
    ("chamber",),
    signals=("valve",),
    make=make,
)
