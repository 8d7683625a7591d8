"""A sensor mounted turned about the arm's axis: it sees each bend in another direction."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.effects.effect import EffectParameter, Filter, InstrumentEffect, Numbers, Where
from softarm.fakes.plant.rotations import product, vector_quaternion


@dataclass(frozen=True)
class Misalignment:
    """Turn poses about the section's axis and bends in their plane."""

    signal: str
    yaw: float

    def update(self, time: float, value: Floats) -> Floats:  # noqa: ARG002
        """Pass a pose or a bend through."""
        if self.signal == "pose":
            turn = vector_quaternion(np.array([0.0, 0.0, self.yaw]))
            return np.concatenate([value[:3], product(value[3:], turn)])
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([cosine * value[0] + sine * value[1], cosine * value[1] - sine * value[0]])


def make(signal: str, where: Where, numbers: Numbers) -> Filter:  # noqa: ARG001
    """Make the filter of one sensor."""
    return Misalignment(signal, numbers["yaw"])


EFFECT = InstrumentEffect(
    "frame_misalignment",
    "yaw",
    {"yaw": EffectParameter("rad", 0.1, 0.04, 0.25)},
    ("sensor",),
    signals=("pose", "bend"),
    make=make,
)
