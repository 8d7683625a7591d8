"""Products of three-vectors and matrices, compiled and without memory of their own.

Loops over numbers, here and wherever the rod is compiled: a sum or an assignment of slices takes numba a
second to compile, each time it is inlined anew.
"""

from numba import njit

from softarm.estimator.arrays import Floats


@njit(cache=True, nogil=True)
def dot(a: Floats, b: Floats) -> float:
    """Return a . b."""
    product: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


@njit(cache=True, nogil=True)
def cross(a: Floats, b: Floats, out: Floats) -> None:
    """Fill out, shape (3,), with a x b."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True, nogil=True)
def rotate(matrix: Floats, vector: Floats, out: Floats) -> None:
    """Fill out, shape (3,), with matrix vector."""
    for r in range(3):
        out[r] = matrix[r, 0] * vector[0] + matrix[r, 1] * vector[1] + matrix[r, 2] * vector[2]


@njit(cache=True, nogil=True)
def add_rotated(matrix: Floats, vector: Floats, out: Floats) -> None:
    """Add matrix vector to out, shape (3,)."""
    for r in range(3):
        out[r] += matrix[r, 0] * vector[0] + matrix[r, 1] * vector[1] + matrix[r, 2] * vector[2]


@njit(cache=True, nogil=True)
def rotate_back(matrix: Floats, vector: Floats, out: Floats) -> None:
    """Fill out, shape (3,), with matrix^T vector."""
    for r in range(3):
        out[r] = matrix[0, r] * vector[0] + matrix[1, r] * vector[1] + matrix[2, r] * vector[2]


@njit(cache=True, nogil=True)
def add_rotated_back(matrix: Floats, vector: Floats, out: Floats) -> None:
    """Add matrix^T vector to out, shape (3,)."""
    for r in range(3):
        out[r] += matrix[0, r] * vector[0] + matrix[1, r] * vector[1] + matrix[2, r] * vector[2]


@njit(cache=True, nogil=True)
def multiply(a: Floats, b: Floats, out: Floats) -> None:
    """Fill out, shape (3, 3), with a b."""
    for r in range(3):
        for s in range(3):
            out[r, s] = a[r, 0] * b[0, s] + a[r, 1] * b[1, s] + a[r, 2] * b[2, s]
