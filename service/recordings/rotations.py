"""Rotation matrices and quaternions (w, x, y, z), many at a time."""

import numpy as np

from estimator.recording import Floats


def quaternions(matrices: Floats) -> Floats:
    """Convert rotation matrices to unit quaternions, w not negative.

    The quaternion is the eigenvector of the largest eigenvalue of a symmetric matrix built from R
    (Bar-Itzhack 2000), which also projects a matrix rounded to a few digits.

    Args:
        matrices: Shape (samples, 3, 3).

    Returns:
        Shape (samples, 4).
    """
    r = matrices
    k = np.empty((len(r), 4, 4))
    k[:, 0, 0] = r[:, 0, 0] + r[:, 1, 1] + r[:, 2, 2]
    k[:, 1, 1] = r[:, 0, 0] - r[:, 1, 1] - r[:, 2, 2]
    k[:, 2, 2] = r[:, 1, 1] - r[:, 0, 0] - r[:, 2, 2]
    k[:, 3, 3] = r[:, 2, 2] - r[:, 0, 0] - r[:, 1, 1]
    k[:, 1, 0] = r[:, 2, 1] - r[:, 1, 2]
    k[:, 2, 0] = r[:, 0, 2] - r[:, 2, 0]
    k[:, 3, 0] = r[:, 1, 0] - r[:, 0, 1]
    k[:, 2, 1] = r[:, 1, 0] + r[:, 0, 1]
    k[:, 3, 1] = r[:, 2, 0] + r[:, 0, 2]
    k[:, 3, 2] = r[:, 2, 1] + r[:, 1, 2]
    vectors = np.linalg.eigh(k).eigenvectors[:, :, -1]
    return np.asarray(vectors * np.where(vectors[:, :1] < 0, -1.0, 1.0))


def matrices(quaternion: Floats) -> Floats:
    """Convert quaternions to rotation matrices.

    Args:
        quaternion: Of any length but zero, shape (samples, 4).

    Returns:
        Shape (samples, 3, 3).
    """
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)
