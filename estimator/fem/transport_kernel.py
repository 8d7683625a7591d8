"""Kernels of the transport of displacements between configurations."""

import numpy as np

from estimator.fem.compiled import compiled
from estimator.mesh import Floats, Indices

SWEEPS = 8
SETTLED = 1e-12


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
def _turn(turn: Floats, field: Floats, back: bool, out: Floats) -> None:
    """Fill T A, or T^T A when ``back``."""
    for i in range(3):
        if back:
            t0, t1, t2 = turn[0, i], turn[1, i], turn[2, i]
        else:
            t0, t1, t2 = turn[i, 0], turn[i, 1], turn[i, 2]
        for k in range(3):
            out[i, k] = t0 * field[0, k] + t1 * field[1, k] + t2 * field[2, k]


@compiled
def _wind(f: Floats, change: Floats, work: Floats) -> None:
    """Replace a change H of the deformation F by exp(spin) (1 + strain) F - F, spin + strain = H F^-1."""
    inverse, h, stretch, rotation = work[0], work[1], work[2], work[3]
    share = 1.0 / _cofactors(f, inverse)
    for i in range(3):
        for k in range(3):
            product = change[i, 0] * inverse[k, 0] + change[i, 1] * inverse[k, 1]
            h[i, k] = share * (product + change[i, 2] * inverse[k, 2])
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
    _multiply(h, f, change)
    for i in range(3):
        for k in range(3):
            change[i, k] -= f[i, k]


@compiled
def _gradient(corners: Floats, slopes: Floats, field: Floats) -> None:
    """Fill d v_i / d X_j at a point from the nodes' values and slopes, both of shape (nodes, 3)."""
    f00, f01, f02, f10, f11, f12, f20, f21, f22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(corners.shape[0]):
        x, y, z = corners[n, 0], corners[n, 1], corners[n, 2]
        g0, g1, g2 = slopes[n, 0], slopes[n, 1], slopes[n, 2]
        f00 += x * g0
        f01 += x * g1
        f02 += x * g2
        f10 += y * g0
        f11 += y * g1
        f12 += y * g2
        f20 += z * g0
        f21 += z * g1
        f22 += z * g2
    field[0, 0], field[0, 1], field[0, 2] = f00, f01, f02
    field[1, 0], field[1, 1], field[1, 2] = f10, f11, f12
    field[2, 0], field[2, 1], field[2, 2] = f20, f21, f22


@compiled
def _spread(field: Floats, weight: float, slopes: Floats, forces: Floats) -> None:
    """Add w A_ij G_nj to every node n, the adjoint of ``_gradient``."""
    w, a = weight, field
    a00, a01, a02 = w * a[0, 0], w * a[0, 1], w * a[0, 2]
    a10, a11, a12 = w * a[1, 0], w * a[1, 1], w * a[1, 2]
    a20, a21, a22 = w * a[2, 0], w * a[2, 1], w * a[2, 2]
    for n in range(forces.shape[0]):
        g0, g1, g2 = slopes[n, 0], slopes[n, 1], slopes[n, 2]
        forces[n, 0] += a00 * g0 + a01 * g1 + a02 * g2
        forces[n, 1] += a10 * g0 + a11 * g1 + a12 * g2
        forces[n, 2] += a20 * g0 + a21 * g1 + a22 * g2


@compiled
def _collect(nodal: Floats, nodes: Indices, corners: Floats) -> None:
    for n in range(nodes.shape[0]):
        for i in range(3):
            corners[n, i] = nodal[nodes[n], i]


@compiled
def _add(forces: Floats, nodes: Indices, nodal: Floats) -> None:
    for n in range(nodes.shape[0]):
        for i in range(3):
            nodal[nodes[n], i] += forces[n, i]


@compiled
def point_gradients(nodal: Floats, connectivity: Indices, gradients: Floats, fields: Floats) -> None:
    """Fill d v_i / d X_j at every point of a block, shape (elements points, 3, 3)."""
    points = gradients.shape[1]
    corners = np.empty((connectivity.shape[1], 3))
    for e in range(connectivity.shape[0]):
        _collect(nodal, connectivity[e], corners)
        for p in range(points):
            _gradient(corners, gradients[e, p], fields[e * points + p])


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
            _spread(fields[e * points + p], weights[e, p], gradients[e, p], forces)
        _add(forces, connectivity[e], nodal)


@compiled
def carry_gradients(
    source: Floats,
    connectivity: Indices,
    gradients: Floats,
    weights: Floats,
    turns: Floats,
    back: bool,
    nodal: Floats,
) -> None:
    """Add the divergence of T A, or of T^T A when ``back``, with A the gradient of ``source``."""
    points = gradients.shape[1]
    corners, forces = np.empty((connectivity.shape[1], 3)), np.empty((connectivity.shape[1], 3))
    field, turned = np.empty((3, 3)), np.empty((3, 3))
    for e in range(connectivity.shape[0]):
        _collect(source, connectivity[e], corners)
        forces[:] = 0.0
        for p in range(points):
            _gradient(corners, gradients[e, p], field)
            _turn(turns[e * points + p], field, back, turned)
            _spread(turned, weights[e, p], gradients[e, p], forces)
        _add(forces, connectivity[e], nodal)


@compiled
def wind_gradients(
    source: Floats,
    connectivity: Indices,
    gradients: Floats,
    weights: Floats,
    turns: Floats,
    deformation: Floats,
    nodal: Floats,
) -> None:
    """Add the divergence of ``_wind``'s change for H = T A, with A the gradient of ``source``."""
    points = gradients.shape[1]
    corners, forces = np.empty((connectivity.shape[1], 3)), np.empty((connectivity.shape[1], 3))
    field, turned, work = np.empty((3, 3)), np.empty((3, 3)), np.empty((4, 3, 3))
    for e in range(connectivity.shape[0]):
        _collect(source, connectivity[e], corners)
        forces[:] = 0.0
        for p in range(points):
            _gradient(corners, gradients[e, p], field)
            _turn(turns[e * points + p], field, False, turned)
            _wind(deformation[e * points + p], turned, work)
            _spread(turned, weights[e, p], gradients[e, p], forces)
        _add(forces, connectivity[e], nodal)


@compiled
def turns_between(inverse_before: Floats, after: Floats, turns: Floats) -> None:
    """Fill the rotation of F_after F_before^-1 at every point, by Newton's iteration (Higham 1986)."""
    work, matrix = np.empty((3, 3)), np.empty((3, 3))
    for p in range(after.shape[0]):
        _multiply(after[p], inverse_before[p], matrix)
        for _ in range(SWEEPS):
            share = 1.0 / _cofactors(matrix, work)
            change = 0.0
            for i in range(3):
                for k in range(3):
                    step = 0.5 * (share * work[i, k] - matrix[i, k])
                    matrix[i, k] += step
                    change = max(change, abs(step))
            if not change * change > SETTLED:
                break
        turns[p] = matrix
