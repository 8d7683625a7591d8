"""Rotations as quaternions (w, x, y, z), vectors and matrices."""

import numpy as np

from softarm.estimator.arrays import Floats


def rotation_matrix(quaternion: Floats) -> Floats:
    """Convert quaternions, shape (..., 4), to rotation matrices, shape (..., 3, 3)."""
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)).T
    # Column by column: the transpose reverses all axes again, those of the matrix as well.
    columns = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
        [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
        [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.array(columns).T


def vector_quaternion(vector: Floats) -> Floats:
    """Convert a rotation vector [rad] to a unit quaternion, shape (4,)."""
    angle = float(np.linalg.norm(vector))
    share = 0.5 * np.sinc(angle / (2.0 * np.pi))
    return np.array([np.cos(0.5 * angle), *(share * vector)])


def quaternion_vector(quaternion: Floats) -> Floats:
    """Convert a unit quaternion to the rotation vector of the shorter way [rad], shape (3,)."""
    w, axis = float(quaternion[0]), np.asarray(quaternion[1:])
    if w < 0.0:
        w, axis = -w, -axis
    sine = float(np.linalg.norm(axis))
    return np.asarray((2.0 * np.arctan2(sine, w) / sine if sine > 1e-12 else 2.0) * axis)


def inverse(quaternion: Floats) -> Floats:
    """Invert a unit quaternion, shape (4,)."""
    return np.asarray(quaternion * np.array([1.0, -1.0, -1.0, -1.0]))


def product(first: Floats, second: Floats) -> Floats:
    """Multiply quaternions: the rotation ``second`` followed by ``first``, shape (..., 4)."""
    a, b = first.T, second.T  # component by component: the transpose reverses all axes
    parts = (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )
    return np.array(parts).T


def tilt(axis: Floats) -> Floats:
    """Return the two-axis tilt of unit vectors: angle to z times direction in the plane [rad], (..., 2)."""
    across = np.hypot(axis[..., 0], axis[..., 1])
    angle = np.arctan2(across, axis[..., 2])
    scale = np.where(across > 0.0, angle / np.where(across > 0.0, across, 1.0), 0.0)
    return scale[..., None] * axis[..., :2]
