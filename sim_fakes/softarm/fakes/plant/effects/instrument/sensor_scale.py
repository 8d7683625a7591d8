"""A sensor whose scale is off: the wand of the cameras, the gain of a strip or a gauge."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.effects.effect import EffectParameter, Filter, InstrumentEffect, Numbers, Where
from softarm.fakes.plant.rotations import inverse, product, quaternion_vector, vector_quaternion


@dataclass
class Scale:
    """Scale a bend or a pull; of a pose, the way and the turn from the first reading."""

    signal: str
    factor: float
    first: Floats | None = None

    def update(self, time: float, value: Floats) -> Floats:  # noqa: ARG002
        """Pass a reading through."""
        if self.signal != "pose":
            return value * self.factor
        if self.first is None:
            self.first = value.copy()
        place, turn = self.first[:3], self.first[3:]
        moved = place + self.factor * (value[:3] - place)
        turned = quaternion_vector(product(inverse(turn), value[3:]))
        return np.concatenate([moved, product(turn, vector_quaternion(self.factor * turned))])


def make(signal: str, where: Where, numbers: Numbers) -> Filter:  # noqa: ARG001
    """Make the filter of one sensor."""
    return Scale(signal, 1.0 + numbers["change"])


EFFECT = InstrumentEffect(
    "sensor_scale",
    "change",
    {"change": EffectParameter("", 0.05, 0.02, 0.15)},
    ("sensor",),
    signals=("pose", "bend", "gauge"),
    make=make,
)
