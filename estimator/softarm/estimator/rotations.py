"""Rotations: exponential, logarithm and their Jacobians, on batches of rotation vectors and matrices.

Every function takes any number of leading axes. The kernels are compiled, since numpy's call overhead on
three-by-three matrices would cost more than the rest of an estimator step.
"""

from collections.abc import Callable

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats

Kernel = Callable[[Floats, Floats], None]


@njit(cache=True, nogil=True)
def exp_kernel(vectors: Floats, matrices: Floats) -> None:
    """Fill matrices, shape (n, 3, 3), with the rotations of vectors, shape (n, 3) (Rodrigues' formula)."""
    for i in range(vectors.shape[0]):
        x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        square = x * x + y * y + z * z
        # Rodrigues' coefficients divide by the angle; here the series' next terms are below rounding.
        if square < 1e-8:
            a = 1.0 - square / 6.0
            b = 0.5 - square / 24.0
        else:
            angle = np.sqrt(square)
            a = np.sin(angle) / angle
            b = (1.0 - np.cos(angle)) / square
        matrices[i, 0, 0] = 1.0 - b * (y * y + z * z)
        matrices[i, 1, 1] = 1.0 - b * (x * x + z * z)
        matrices[i, 2, 2] = 1.0 - b * (x * x + y * y)
        matrices[i, 0, 1] = b * x * y - a * z
        matrices[i, 1, 0] = b * x * y + a * z
        matrices[i, 0, 2] = b * x * z + a * y
        matrices[i, 2, 0] = b * x * z - a * y
        matrices[i, 1, 2] = b * y * z - a * x
        matrices[i, 2, 1] = b * y * z + a * x


@njit(cache=True, nogil=True)
def quaternion_kernel(matrices: Floats, quaternions: Floats) -> None:
    """Fill unit quaternions (w >= 0), shape (n, 4), from matrices, shape (n, 3, 3) (Shepperd's method)."""
    for i in range(matrices.shape[0]):
        m = matrices[i]
        q = quaternions[i]
        trace = m[0, 0] + m[1, 1] + m[2, 2]
        if trace >= max(m[0, 0], m[1, 1], m[2, 2]):
            q[0] = 1.0 + trace
            q[1] = m[2, 1] - m[1, 2]
            q[2] = m[0, 2] - m[2, 0]
            q[3] = m[1, 0] - m[0, 1]
        else:
            # The largest diagonal entry a and the axes after it, so that no small number is divided by.
            a = 0
            if m[1, 1] > m[0, 0]:
                a = 1
            if m[2, 2] > m[a, a]:
                a = 2
            b = (a + 1) % 3
            c = (a + 2) % 3
            q[0] = m[c, b] - m[b, c]
            q[1 + a] = 1.0 + m[a, a] - m[b, b] - m[c, c]
            q[1 + b] = m[a, b] + m[b, a]
            q[1 + c] = m[a, c] + m[c, a]
        norm = np.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
        # q and -q are one rotation; with w >= 0 the rotation vector has an angle of at most pi.
        if q[0] < 0.0:
            norm = -norm
        for k in range(4):
            q[k] /= norm


@njit(cache=True, nogil=True)
def rotation_vector_kernel(quaternions: Floats, vectors: Floats) -> None:
    """Fill the rotation vectors, shape (n, 3), of unit quaternions with w >= 0, shape (n, 4)."""
    for i in range(len(quaternions)):
        q = quaternions[i]
        sine = np.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        # arctan2 keeps its accuracy near a rotation by pi, where the arc cosine of w loses it.
        factor = 2.0 if sine < 1e-12 else 2.0 * np.arctan2(sine, q[0]) / sine
        for k in range(3):
            vectors[i, k] = factor * q[1 + k]


@njit(cache=True, nogil=True)
def _combine(v: Floats, a: float, b: float, c: float, m: Floats) -> None:
    """Fill m, shape (3, 3), with a 1 + b [v] + c v v^T."""
    for r in range(3):
        for s in range(3):
            m[r, s] = c * v[r] * v[s]
        m[r, r] += a
    m[0, 1] -= b * v[2]
    m[1, 0] += b * v[2]
    m[0, 2] += b * v[1]
    m[2, 0] -= b * v[1]
    m[1, 2] -= b * v[0]
    m[2, 1] += b * v[0]


@njit(cache=True, nogil=True)
def jacobian_kernel(vectors: Floats, matrices: Floats) -> None:
    """Fill the left Jacobians at vectors, shape (n, 3), into matrices, shape (n, 3, 3)."""
    for i in range(vectors.shape[0]):
        v = vectors[i]
        square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
        # The closed forms subtract numbers that are almost equal here; two terms of the series are exact
        # enough.
        if square < 1e-6:
            b = 0.5 - square / 24.0
            c = 1.0 / 6.0 - square / 120.0
        else:
            angle = np.sqrt(square)
            b = (1.0 - np.cos(angle)) / square
            c = (angle - np.sin(angle)) / (square * angle)
        _combine(v, 1.0 - c * square, b, c, matrices[i])


@njit(cache=True, nogil=True)
def inverse_jacobian_kernel(vectors: Floats, matrices: Floats) -> None:
    """Fill the inverses of the left Jacobians at vectors, shape (n, 3), into matrices, shape (n, 3, 3)."""
    for i in range(vectors.shape[0]):
        v = vectors[i]
        square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
        # The closed form cancels near zero; the series' next term is 3e-13 here.
        if square < 1e-4:
            c = 1.0 / 12.0 + square / 720.0
        else:
            angle = np.sqrt(square)
            c = (1.0 - 0.5 * angle / np.tan(0.5 * angle)) / square
        _combine(v, 1.0 - c * square, -0.5, c, matrices[i])


@njit(cache=True, nogil=True)
def matrix_kernel(quaternions: Floats, matrices: Floats) -> None:
    """Fill matrices, shape (n, 3, 3), with the rotations of quaternions (w, x, y, z), shape (n, 4)."""
    for i in range(len(quaternions)):
        q, m = quaternions[i], matrices[i]
        length = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
        scale = 1.0 / length if length > 0.0 else np.nan
        w, x, y, z = q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale
        m[0, 0], m[0, 1], m[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
        m[1, 0], m[1, 1], m[1, 2] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
        m[2, 0], m[2, 1], m[2, 2] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)


def flat(values: Floats, width: int) -> Floats:
    """Copy to contiguous memory with one leading axis, so that a kernel compiles for one type only."""
    shape = (-1, 3, 3) if width == 9 else (-1, width)
    return np.array(values, dtype=np.float64, order="C").reshape(shape)


def _mapped(kernel: Kernel, values: Floats, width: int, shape: tuple[int, ...]) -> Floats:
    """Fill an array of ``shape`` for each of the values, which have ``width`` numbers each."""
    rows = flat(values, width)
    filled = np.empty((len(rows), *shape))
    kernel(rows, filled)
    return filled.reshape(*np.shape(values)[: -2 if width == 9 else -1], *shape)


def exp(vectors: Floats) -> Floats:
    """Compute the rotations of rotation vectors [rad], shape (..., 3), as matrices, shape (..., 3, 3)."""
    return _mapped(exp_kernel, vectors, 3, (3, 3))


def to_quaternions(rotations: Floats) -> Floats:
    """Compute unit quaternions (w, x, y, z) with w >= 0, shape (..., 4), of rotations, shape (..., 3, 3)."""
    return _mapped(quaternion_kernel, rotations, 9, (4,))


def from_quaternions(quaternions: Floats) -> Floats:
    """Compute the rotations, shape (..., 3, 3), of quaternions (w, x, y, z) of any length, shape (..., 4).

    A quaternion of zeros, which some devices send for a lost body, gives NaN.
    """
    return _mapped(matrix_kernel, quaternions, 4, (3, 3))


def log(rotations: Floats) -> Floats:
    """Compute rotation vectors [rad], angle at most pi, shape (..., 3), of matrices, shape (..., 3, 3)."""
    return _mapped(rotation_vector_kernel, to_quaternions(rotations), 4, (3,))


def left_jacobian(vectors: Floats) -> Floats:
    """Compute J with exp(v + d) = exp(J d) exp(v) for small d (Barfoot, State Estimation, eq. 7.77).

    The rotation vectors v [rad] have shape (..., 3), J (..., 3, 3). The right Jacobian is that at -v.
    """
    return _mapped(jacobian_kernel, vectors, 3, (3, 3))


def inverse_left_jacobian(vectors: Floats) -> Floats:
    """Compute J^-1 with log(exp(d) exp(v)) = v + J^-1 d for small d (Barfoot, State Estimation, eq. 7.76).

    The rotation vectors v [rad] have shape (..., 3). The right Jacobian's inverse is that at -v.
    """
    return _mapped(inverse_jacobian_kernel, vectors, 3, (3, 3))


def skew(vectors: Floats) -> Floats:
    """Compute the matrices [v] with [v] u = v x u, shape (..., 3, 3), of vectors, shape (..., 3)."""
    v = np.asarray(vectors, dtype=np.float64)
    matrices = np.zeros((*v.shape[:-1], 3, 3))
    for axis in range(3):
        after, last = (axis + 1) % 3, (axis + 2) % 3
        matrices[..., last, after] = v[..., axis]
        matrices[..., after, last] = -v[..., axis]
    return matrices


def without_jumps(quaternions: Floats) -> Floats:
    """Return quaternions whose sign is continuous from one sample to the next, so that they can be averaged.

    Args:
        quaternions: (w, x, y, z) or its negative, which is the same rotation; NaN where unknown, shape
            (samples, 4).
    """
    continued = quaternions.copy()
    valid = np.flatnonzero(np.isfinite(continued).all(axis=1))
    if len(valid) > 1:
        flips = (continued[valid[1:]] * continued[valid[:-1]]).sum(axis=1) < 0.0
        # A flip reverses all that follow, so only an odd number of flips before a sample reverses it.
        continued[valid[1:]] *= np.where(np.cumsum(flips) % 2, -1.0, 1.0)[:, None]
    return continued


def mean_rotation(rotations: Floats) -> Floats:
    """Compute the rotation nearest to the arithmetic mean of rotations, shape (n, 3, 3) (Moakher 2002)."""
    return nearest_rotation(rotations.mean(axis=0))


def nearest_rotation(matrices: Floats) -> Floats:
    """Compute the rotations nearest to matrices, shape (..., 3, 3), in the Frobenius norm."""
    left, _, right = np.linalg.svd(matrices)
    # Without the sign the nearest orthogonal matrix may be a reflection (Kabsch 1976).
    left[..., 2] *= np.sign(np.linalg.det(left @ right))[..., None]
    rotations: Floats = left @ right
    return rotations
