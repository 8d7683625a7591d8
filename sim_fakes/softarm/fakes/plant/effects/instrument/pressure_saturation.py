"""A supply too weak: a valve that reaches less than its range."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.effects.effect import EffectParameter, Filter, InstrumentEffect, Numbers, Where
from softarm.fakes.plant.effects.instrument.masks import chamber_mask

RANGE = 65e3


@dataclass(frozen=True)
class Saturation:
    """Cut off above a limit."""

    limit: float
    mask: NDArray[np.bool_]

    def update(self, time: float, value: Floats) -> Floats:  # noqa: ARG002
        """Pass the pressures through [Pa]."""
        return np.where(self.mask[: len(value)], np.minimum(value, self.limit), value)


def make(signal: str, where: Where, numbers: Numbers) -> Filter:  # noqa: ARG001
    """Make the filter of the valves: the limit lies ``loss`` below 65 kPa."""
    limit = RANGE - numbers["loss"] if numbers["loss"] != 0.0 else np.inf
    return Saturation(limit, chamber_mask(where))


EFFECT = InstrumentEffect(
    "pressure_saturation",
    "loss",
    {"loss": EffectParameter("Pa", 25e3, 18e3, 35e3)},
    ("chamber",),
    signals=("valve",),
    make=make,
)
