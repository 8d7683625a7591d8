"""A sensor that wanders off steadily with the clock."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.effects.effect import EffectParameter, Filter, InstrumentEffect, Numbers, Where
from softarm.fakes.plant.effects.instrument.attitude import turned
from softarm.fakes.plant.effects.places import azimuth


@dataclass(frozen=True)
class GrowingOffset:
    """Add what has grown since time 0."""

    signal: str
    vector: Floats
    offset: float

    def update(self, time: float, value: Floats) -> Floats:
        """Pass a reading through."""
        if self.signal in ("pose", "bend"):
            return turned(self.signal, value, time * self.vector)
        return value + time * self.offset


def make(signal: str, where: Where, numbers: Numbers) -> Filter:
    """Make the filter: an orientation turns at ``rate`` about ``axis``, a gauge goes off by ``offset``."""
    direction = azimuth(where)
    vector = numbers["rate"] * np.array([np.cos(direction), np.sin(direction), 0.0])
    return GrowingOffset(signal, vector, numbers["offset"] if numbers["rate"] != 0.0 else 0.0)


EFFECT = InstrumentEffect(
    "sensor_drift",
    "rate",
    {"rate": EffectParameter("rad/s", 1e-4, 4e-5, 4e-4), "offset": EffectParameter("N/s", 2e-4, 5e-5, 5e-4)},
    ("sensor", "axis"),
    signals=("pose", "bend", "gauge"),
    make=make,
)
