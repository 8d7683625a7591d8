"""A sensor that is off by a constant."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.effects.effect import EffectParameter, Filter, InstrumentEffect, Numbers, Where
from softarm.fakes.plant.effects.instrument.attitude import turned
from softarm.fakes.plant.effects.places import azimuth


@dataclass(frozen=True)
class ReadingOffset:
    """Add a constant, or what grows from time 0: a rotation to an orientation, newtons to a gauge."""

    signal: str
    vector: Floats
    offset: float
    grows: bool

    def update(self, time: float, value: Floats) -> Floats:
        """Pass a reading through."""
        share = time if self.grows else 1.0
        if self.signal in ("pose", "bend"):
            return turned(self.signal, value, share * self.vector)
        return value + share * self.offset


def offset_filter(signal: str, where: Where, angle: float, offset: float, *, grows: bool = False) -> Filter:
    """Make a filter: an orientation is off by an angle about the axis of a place, a gauge by an offset."""
    direction = azimuth(where)
    vector = angle * np.array([np.cos(direction), np.sin(direction), 0.0])
    return ReadingOffset(signal, vector, offset if angle != 0.0 else 0.0, grows)


def make(signal: str, where: Where, numbers: Numbers) -> Filter:
    """Make the filter: an orientation is off by ``angle`` about ``axis``, a gauge by ``offset``."""
    return offset_filter(signal, where, numbers["angle"], numbers["offset"])


EFFECT = InstrumentEffect(
    "sensor_bias",
    "angle",
    {"angle": EffectParameter("rad", 0.03, 0.012, 0.1), "offset": EffectParameter("N", 0.05, 0.02, 0.2)},
    ("sensor", "axis"),
    signals=("pose", "bend", "gauge"),
    make=make,
)
