"""A valve whose own sensor is off: the pressure it gives differs from what it says."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.effects.effect import EffectParameter, Filter, InstrumentEffect, Numbers, Where
from softarm.fakes.plant.effects.instrument.masks import chamber_mask


@dataclass(frozen=True)
class PressureOffset:
    """Regulate above or below the set-point, except when vented; the valve's own sensor does not see it."""

    bias: float
    mask: NDArray[np.bool_]

    def update(self, time: float, value: Floats) -> Floats:  # noqa: ARG002
        """Pass the pressures through [Pa]."""
        driven = self.mask[: len(value)] & (value > 0.0)
        return np.where(driven, np.maximum(0.0, value + self.bias), value)


def make(signal: str, where: Where, numbers: Numbers) -> Filter:
    """Make the filter of the valves, or of what they say of the pressure they give."""
    bias = numbers["bias"] if signal == "valve" else -numbers["bias"]
    return PressureOffset(bias, chamber_mask(where))


EFFECT = InstrumentEffect(
    "pressure_bias",
    "bias",
    {"bias": EffectParameter("Pa", 2e3, 0.7e3, 5e3)},
    ("chamber",),
    signals=("valve", "pressure"),
    make=make,
)
