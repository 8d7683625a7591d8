"""Kernels of the transport of displacements between configurations."""

import numpy as np

from estimator.fem.compiled import compiled
from estimator.mesh import Floats, Indices

SWEEPS = 8
SETTLED = 1e-12


@compiled
def point_gradients(nodal: Floats, connectivity: Indices, gradients: Floats, fields: Floats) -> None:
    """Fill d v_i / d X_j at every point of a block, shape (elements points, 3, 3)."""
    points = gradients.shape[1]
    corners = np.empty((connectivity.shape[1], 3))
    for e in range(connectivity.shape[0]):
        for n in range(connectivity.shape[1]):
            for i in range(3):
                corners[n, i] = nodal[connectivity[e, n], i]
        for p in range(points):
            f00, f01, f02, f10, f11, f12, f20, f21, f22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for n in range(connectivity.shape[1]):
                x, y, z = corners[n, 0], corners[n, 1], corners[n, 2]
                g0, g1, g2 = gradients[e, p, n, 0], gradients[e, p, n, 1], gradients[e, p, n, 2]
                f00 += x * g0
                f01 += x * g1
                f02 += x * g2
                f10 += y * g0
                f11 += y * g1
                f12 += y * g2
                f20 += z * g0
                f21 += z * g1
                f22 += z * g2
            out = fields[e * points + p]
            out[0, 0], out[0, 1], out[0, 2] = f00, f01, f02
            out[1, 0], out[1, 1], out[1, 2] = f10, f11, f12
            out[2, 0], out[2, 1], out[2, 2] = f20, f21, f22


@compiled
def point_divergence(
    fields: Floats, connectivity: Indices, gradients: Floats, weights: Floats, nodal: Floats
) -> None:
    """Add sum_q w_q A_ij G_nj to every node n, the adjoint of ``point_gradients``."""
    points = gradients.shape[1]
    forces = np.empty((connectivity.shape[1], 3))
    for e in range(connectivity.shape[0]):
        forces[:] = 0.0
        for p in range(points):
            a, w = fields[e * points + p], weights[e, p]
            a00, a01, a02 = w * a[0, 0], w * a[0, 1], w * a[0, 2]
            a10, a11, a12 = w * a[1, 0], w * a[1, 1], w * a[1, 2]
            a20, a21, a22 = w * a[2, 0], w * a[2, 1], w * a[2, 2]
            for n in range(connectivity.shape[1]):
                g0, g1, g2 = gradients[e, p, n, 0], gradients[e, p, n, 1], gradients[e, p, n, 2]
                forces[n, 0] += a00 * g0 + a01 * g1 + a02 * g2
                forces[n, 1] += a10 * g0 + a11 * g1 + a12 * g2
                forces[n, 2] += a20 * g0 + a21 * g1 + a22 * g2
        for n in range(connectivity.shape[1]):
            for i in range(3):
                nodal[connectivity[e, n], i] += forces[n, i]


@compiled
def _multiply(a: Floats, b: Floats, out: Floats) -> None:
    for i in range(3):
        for k in range(3):
            out[i, k] = a[i, 0] * b[0, k] + a[i, 1] * b[1, k] + a[i, 2] * b[2, k]


@compiled
def _cofactors(m: Floats, out: Floats) -> float:
    """Fill det(m) m^-T; return the determinant."""
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        for k in range(3):
            c, d = (k + 1) % 3, (k + 2) % 3
            out[i, k] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
    return float(m[0, 0] * out[0, 0] + m[0, 1] * out[0, 1] + m[0, 2] * out[0, 2])


@compiled
def turns_between(inverse_before: Floats, after: Floats, turns: Floats) -> None:
    """Fill the rotation of F_after F_before^-1 at every point, by Newton's iteration (Higham 1986)."""
    work, matrix = np.empty((3, 3)), np.empty((3, 3))
    for p in range(after.shape[0]):
        _multiply(after[p], inverse_before[p], matrix)
        for _ in range(SWEEPS):
            determinant = _cofactors(matrix, work)
            change = 0.0
            for i in range(3):
                for k in range(3):
                    step = 0.5 * (work[i, k] / determinant - matrix[i, k])
                    matrix[i, k] += step
                    change = max(change, abs(step))
            if not change * change > SETTLED:
                break
        turns[p] = matrix


@compiled
def turn_fields(turns: Floats, fields: Floats, back: bool) -> None:
    """Replace each field A by T A, or by T^T A when ``back``."""
    turned = np.empty((3, 3))
    for p in range(fields.shape[0]):
        t, a = turns[p], fields[p]
        if back:
            t = t.T
        for i in range(3):
            for k in range(3):
                turned[i, k] = t[i, 0] * a[0, k] + t[i, 1] * a[1, k] + t[i, 2] * a[2, k]
        for i in range(3):
            for k in range(3):
                a[i, k] = turned[i, k]


@compiled
def wind_fields(deformation: Floats, fields: Floats) -> None:
    """Replace each change H of the deformation F by exp(spin) (1 + strain) F - F, spin + strain = H F^-1."""
    inverse, h, stretch, rotation = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for p in range(fields.shape[0]):
        f = deformation[p]
        determinant = _cofactors(f, inverse)
        for i in range(3):
            for k in range(3):
                h[i, k] = 0.0
                for m in range(3):
                    h[i, k] += fields[p, i, m] * inverse[k, m] / determinant
        x, y, z = 0.5 * (h[2, 1] - h[1, 2]), 0.5 * (h[0, 2] - h[2, 0]), 0.5 * (h[1, 0] - h[0, 1])
        square = x * x + y * y + z * z
        angle = np.sqrt(square)
        sine = 1.0 - square / 6.0 if angle < 1e-3 else np.sin(angle) / angle
        rest = 0.5 - square / 24.0 if angle < 1e-3 else (1.0 - np.cos(angle)) / square
        rotation[0, 0] = 1.0 - rest * (y * y + z * z)
        rotation[1, 1] = 1.0 - rest * (x * x + z * z)
        rotation[2, 2] = 1.0 - rest * (x * x + y * y)
        rotation[0, 1], rotation[1, 0] = rest * x * y - sine * z, rest * x * y + sine * z
        rotation[0, 2], rotation[2, 0] = rest * x * z + sine * y, rest * x * z - sine * y
        rotation[1, 2], rotation[2, 1] = rest * y * z - sine * x, rest * y * z + sine * x
        for i in range(3):
            for k in range(3):
                stretch[i, k] = 0.5 * (h[i, k] + h[k, i]) + (1.0 if i == k else 0.0)
        _multiply(rotation, stretch, h)
        _multiply(h, f, fields[p])
        for i in range(3):
            for k in range(3):
                fields[p, i, k] -= f[i, k]
