"""Products, inverses and roots of a few rows and columns, in compiled kernels.

numpy takes longer to call LAPACK on such a matrix than these loops take for all of it.
"""

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats


@njit(cache=True, nogil=True)
def product(a: Floats, b: Floats, out: Floats) -> None:
    """Fill out with a b."""
    for r in range(out.shape[0]):
        for c in range(out.shape[1]):
            total = 0.0
            for k in range(b.shape[0]):
                total += a[r, k] * b[k, c]
            out[r, c] = total


@njit(cache=True, nogil=True)
def add_congruence(factor: float, a: Floats, b: Floats, out: Floats) -> None:
    """Add factor times a b a^T, with b symmetric, to out; the sum stays symmetric."""
    rows, inner = a.shape
    along = np.empty(inner)
    for r in range(rows):
        for k in range(inner):
            total = 0.0
            for m in range(inner):
                total += a[r, m] * b[m, k]
            along[k] = factor * total
        for c in range(r + 1):
            total = 0.0
            for k in range(inner):
                total += along[k] * a[c, k]
            out[r, c] += total
            if c < r:
                out[c, r] += total


@njit(cache=True, nogil=True)
def invert(a: Floats, out: Floats) -> float:
    """Fill out with the inverse of a (Gauss and Jordan, with row pivots); return log |det a|."""
    size, left, logarithm = len(a), a.copy(), 0.0
    out.fill(0.0)
    for k in range(size):
        out[k, k] = 1.0
    for k in range(size):
        pivot = k
        for r in range(k + 1, size):
            if abs(left[r, k]) > abs(left[pivot, k]):
                pivot = r
        for c in range(size):
            left[k, c], left[pivot, c] = left[pivot, c], left[k, c]
            out[k, c], out[pivot, c] = out[pivot, c], out[k, c]
        logarithm += np.log(abs(left[k, k]))
        scale = 1.0 / left[k, k]
        for c in range(size):
            left[k, c] *= scale
            out[k, c] *= scale
        for r in range(size):
            factor = left[r, k]
            if r != k and factor != 0.0:
                for c in range(size):
                    left[r, c] -= factor * left[k, c]
                    out[r, c] -= factor * out[k, c]
    return logarithm


@njit(cache=True, nogil=True)
def factorise(a: Floats, lower: Floats) -> bool:
    """Fill lower with the Cholesky factor of a; return whether a is positive definite."""
    size = len(a)
    lower.fill(0.0)
    for r in range(size):
        for c in range(r + 1):
            total = a[r, c]
            for k in range(c):
                total -= lower[r, k] * lower[c, k]
            if r == c:
                # Written so that NaN counts as not positive definite.
                if not total > 0.0:
                    return False
                lower[r, r] = np.sqrt(total)
            else:
                lower[r, c] = total / lower[c, c]
    return True


@njit(cache=True, nogil=True)
def solve_factored(lower: Floats, value: Floats) -> None:
    """Solve with a Cholesky factor in place, shape (n,)."""
    size = len(lower)
    for r in range(size):
        for k in range(r):
            value[r] -= lower[r, k] * value[k]
        value[r] /= lower[r, r]
    for r in range(size - 1, -1, -1):
        for k in range(r + 1, size):
            value[r] -= lower[k, r] * value[k]
        value[r] /= lower[r, r]
