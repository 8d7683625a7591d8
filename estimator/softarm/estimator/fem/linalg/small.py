"""Three-by-three matrices: inverse and polar rotation, compiled."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.fem.compiled import compiled

POLAR_SWEEPS = 40
"""Sweeps after which an iteration that does not settle is ended."""


@compiled
def invert_matrix(matrix: Floats, out: Floats) -> float:
    """Invert a 3 x 3 matrix into ``out``; return its determinant."""
    m = matrix
    out[0, 0] = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    out[1, 0] = m[1, 2] * m[2, 0] - m[1, 0] * m[2, 2]
    out[2, 0] = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    out[0, 1] = m[0, 2] * m[2, 1] - m[0, 1] * m[2, 2]
    out[1, 1] = m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0]
    out[2, 1] = m[0, 1] * m[2, 0] - m[0, 0] * m[2, 1]
    out[0, 2] = m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]
    out[1, 2] = m[0, 2] * m[1, 0] - m[0, 0] * m[1, 2]
    out[2, 2] = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    determinant = m[0, 0] * out[0, 0] + m[0, 1] * out[1, 0] + m[0, 2] * out[2, 0]
    for i in range(3):
        for k in range(3):
            out[i, k] /= determinant
    return float(determinant)


@compiled
def polar_rotation(matrix: Floats, rotation: Floats, work: Floats) -> None:
    """Compute the rotation of a matrix by Newton's iteration R <- (R + R^-T) / 2 (Higham 1986)."""
    for i in range(3):
        for k in range(3):
            rotation[i, k] = matrix[i, k]
    for _ in range(POLAR_SWEEPS):
        # Higham's scaling by the determinant: without it a matrix that stretches much takes many sweeps.
        scale = abs(invert_matrix(rotation, work)) ** (-1.0 / 3.0)
        change = 0.0
        for i in range(3):
            for k in range(3):
                after = 0.5 * (scale * rotation[i, k] + work[k, i] / scale)
                change = max(change, abs(after - rotation[i, k]))
                rotation[i, k] = after
        if not change > 1e-15:
            return


@compiled
def _fill_rotations(matrices: Floats, rotations: Floats) -> None:
    work = np.empty((3, 3))
    for p in range(matrices.shape[0]):
        polar_rotation(matrices[p], rotations[p], work)


def polar_rotations(matrices: Floats) -> Floats:
    """Compute the polar rotations of matrices, shape (n, 3, 3)."""
    rotations = np.empty_like(matrices)
    _fill_rotations(np.ascontiguousarray(matrices), rotations)
    return rotations
