"""Small dense systems, compiled."""

from numba import njit

from softarm.estimator.arrays import Floats


@njit(cache=True, nogil=True, error_model="numpy")
def eliminate(matrix: Floats, right: Floats) -> None:
    """Solve matrix x = right in place, by Gaussian elimination with partial pivoting.

    As fast as LAPACK at the size of a rod, and compiled in a second where ``numpy.linalg.solve`` takes ten.

    Args:
        matrix: Overwritten, shape (n, n). A singular one gives infinite or undefined numbers.
        right: Overwritten by x, shape (n, columns).
    """
    size = len(matrix)
    for k in range(size):
        pivot = k
        for i in range(k + 1, size):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        _swap(matrix, k, pivot)
        _swap(right, k, pivot)
        for i in range(k + 1, size):
            factor = matrix[i, k] / matrix[k, k]
            _subtract(matrix, i, factor, k, k + 1)
            _subtract(right, i, factor, k, 0)
    for k in range(size - 1, -1, -1):
        for i in range(k + 1, size):
            _subtract(right, k, matrix[k, i], i, 0)
        for j in range(right.shape[1]):
            right[k, j] /= matrix[k, k]


@njit(cache=True, nogil=True)
def _swap(matrix: Floats, one: int, other: int) -> None:
    for j in range(matrix.shape[1]):
        matrix[one, j], matrix[other, j] = matrix[other, j], matrix[one, j]


@njit(cache=True, nogil=True)
def _subtract(matrix: Floats, row: int, factor: float, other: int, begin: int) -> None:
    """Subtract a multiple of another row from a row, from a column on."""
    for j in range(begin, matrix.shape[1]):
        matrix[row, j] -= factor * matrix[other, j]
