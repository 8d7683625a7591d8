"""A sensor that is off by a constant."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.effects.effect import EffectParameter, Filter, InstrumentEffect, Numbers, Where
from softarm.fakes.plant.effects.instrument.attitude import turned
from softarm.fakes.plant.effects.places import azimuth


@dataclass(frozen=True)
class ReadingOffset:
    """Add a constant: a rotation to an orientation, newtons to a gauge, pascals to a pressure."""

    signal: str
    vector: Floats
    offset: float

    def update(self, time: float, value: Floats) -> Floats:  # noqa: ARG002
        """Pass a reading through."""
        if self.signal in ("pose", "bend"):
            return turned(self.signal, value, self.vector)
        return value + self.offset


def make(signal: str, where: Where, numbers: Numbers) -> Filter:
    """Make the filter: an orientation is off by ``angle`` about ``axis``, a gauge by ``offset``."""
    direction = azimuth(where)
    vector = numbers["angle"] * np.array([np.cos(direction), np.sin(direction), 0.0])
    return ReadingOffset(signal, vector, numbers["offset"] if numbers["angle"] != 0.0 else 0.0)


EFFECT = InstrumentEffect(
    "sensor_bias",
    "angle",
    {"angle": EffectParameter("rad", 0.03, 0.012, 0.1), "offset": EffectParameter("N", 0.05, 0.02, 0.2)},
    ("sensor", "axis"),
    signals=("pose", "bend", "gauge"),
    make=make,
)
