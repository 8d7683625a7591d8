"""Readings as vectors that small errors are added to: angles and places as they are, frames by their turn."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.rotations import exp, from_quaternions, log, to_quaternions

QUATERNION = 4
"""Entries of an orientation; a pose has as many after its place."""


def turns(reading: Floats) -> bool:
    """Return whether a reading is an orientation or a pose."""
    return reading.shape[-1] in (QUATERNION, 3 + QUATERNION)


def to_vector(reading: Floats) -> Floats:
    """Return the rotation vector of an orientation or a pose, else the value, shape (samples, size)."""
    if not turns(reading):
        return reading
    return log(from_quaternions(reading[:, -QUATERNION:]))


def from_vector(vector: Floats, reading: Floats, offset: Floats) -> Floats:
    """Return the reading that a vector stands for, an offset added in the sensor's own axes.

    Args:
        vector: As from ``to_vector``, shape (samples, size).
        reading: The reading whose place a pose keeps, shape (samples, entries).
        offset: Added to angles; the rotation vector of a further turn of a frame; shape (size,) or
            (samples, size).
    """
    if not turns(reading):
        changed: Floats = vector + offset
        return changed
    quaternions = to_quaternions(exp(vector) @ exp(np.broadcast_to(offset, vector.shape)))
    return np.concatenate([reading[:, :-QUATERNION], quaternions], axis=-1)
