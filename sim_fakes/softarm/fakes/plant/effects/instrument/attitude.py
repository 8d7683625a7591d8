"""Turning what a sensor of orientation says, whether it gives a pose or a bend."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.rotations import product, vector_quaternion


def turned(signal: str, value: Floats, vector: Floats) -> Floats:
    """Add a rotation in the sensor's frame [rad] to a pose or, by its first two components, to a bend.

    A small rotation (a, b) about x and y tilts the z axis by (b, -a).
    """
    if signal == "pose":
        return np.concatenate([value[:3], product(value[3:], vector_quaternion(vector))])
    return np.asarray(value + np.array([vector[1], -vector[0]]))
