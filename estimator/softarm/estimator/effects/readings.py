"""Readings with small errors added: to angles and places as they are, to frames as rotations."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.rotations import exp, from_quaternions, to_quaternions

QUATERNION = 4
"""Entries of an orientation; a pose has as many after its place."""


def has_orientation(reading: Floats) -> bool:
    """Return whether a reading is an orientation or a pose."""
    return reading.shape[-1] in (QUATERNION, 3 + QUATERNION)


def with_offset(reading: Floats, offset: Floats) -> Floats:
    """Add an offset in the sensor's own axes: to angles and places as it is, to a frame as a rotation.

    Args:
        reading: Shape (samples, entries).
        offset: Rotation vector, or what is added to a value; entries that it lacks are zero, shape (size,)
            or (samples, size).
    """
    whole = np.zeros((len(reading), 3 if has_orientation(reading) else reading.shape[-1]))
    size = min(whole.shape[1], offset.shape[-1])
    whole[:, :size] = offset[..., :size]
    if not has_orientation(reading):
        changed: Floats = reading + whole
        return changed
    quaternions = to_quaternions(from_quaternions(reading[:, -QUATERNION:]) @ exp(whole))
    return np.concatenate([reading[:, :-QUATERNION], quaternions], axis=-1)
