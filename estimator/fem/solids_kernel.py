"""Kernel of the hyperelastic elements.

With F the deformation gradient, J = det F, I = J^(-2/3) F:F, and for node a its rest gradient G_a,
f_a = F G_a and h_a = F^-T G_a, the derivatives of the isochoric energy psi(I) are

    d psi / d x_a        = psi' q_a,           q_a = J^(-2/3) (2 f_a - 2/3 F:F h_a)
    d2 psi / d x_a d x_b = psi'' q_a q_b^T + psi' J^(-2/3) [ 2 (G_a . G_b) 1 - 4/3 (f_a h_b^T + h_a f_b^T)
                           + 4/9 F:F h_a h_b^T + 2/3 F:F h_b h_a^T ]

and of the volumetric energy V U(m), m = sum_q w_q J_q / V, with b_a = sum_q w_q J h_a:

    U' b_a   and   U''/V b_a b_b^T + U' sum_q w_q J (h_a h_b^T - h_b h_a^T).
"""

import numpy as np

from estimator.fem.compiled import compiled
from estimator.fem.pattern import Slots
from estimator.mesh import Floats, Indices


@compiled
def isochoric_slopes(code: float, half: float, a: float, b: float, excess: float) -> tuple[float, float]:
    """Give psi' and psi'' at I - 3 = ``excess``; the laws stand in ``Material``."""
    if code == 1.0:
        return half * (1.0 + (2.0 * a + 3.0 * b * excess) * excess), half * (2.0 * a + 6.0 * b * excess)
    if code == 2.0:
        left = a - excess
        if left <= 0.0:
            return np.nan, np.nan
        return half * a / left, half * a / (left * left)
    if code == 3.0:
        decay = (1.0 - a) * np.exp(-b * excess)
        return half * (a + decay), -half * b * decay
    return half, 0.0


@compiled
def _deform(corners: Floats, gradients: Floats, f: Floats, h: Floats) -> tuple[float, float]:
    """Fill f and h, both of shape (3, nodes), for one point; return J and F:F."""
    nodes = corners.shape[1]
    deformation = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            total = 0.0
            for n in range(nodes):
                total += corners[i, n] * gradients[j, n]
            deformation[i, j] = total
    F = deformation
    c00 = F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1]
    c01 = F[1, 2] * F[2, 0] - F[1, 0] * F[2, 2]
    c02 = F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0]
    c10 = F[2, 1] * F[0, 2] - F[2, 2] * F[0, 1]
    c11 = F[2, 2] * F[0, 0] - F[2, 0] * F[0, 2]
    c12 = F[2, 0] * F[0, 1] - F[2, 1] * F[0, 0]
    c20 = F[0, 1] * F[1, 2] - F[0, 2] * F[1, 1]
    c21 = F[0, 2] * F[1, 0] - F[0, 0] * F[1, 2]
    c22 = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    ratio = F[0, 0] * c00 + F[0, 1] * c01 + F[0, 2] * c02
    inverse = 1.0 / ratio
    square = 0.0
    for i in range(3):
        for j in range(3):
            square += F[i, j] * F[i, j]
    for n in range(nodes):
        g0, g1, g2 = gradients[0, n], gradients[1, n], gradients[2, n]
        f[0, n] = F[0, 0] * g0 + F[0, 1] * g1 + F[0, 2] * g2
        f[1, n] = F[1, 0] * g0 + F[1, 1] * g1 + F[1, 2] * g2
        f[2, n] = F[2, 0] * g0 + F[2, 1] * g1 + F[2, 2] * g2
        h[0, n] = (c00 * g0 + c01 * g1 + c02 * g2) * inverse
        h[1, n] = (c10 * g0 + c11 * g1 + c12 * g2) * inverse
        h[2, n] = (c20 * g0 + c21 * g1 + c22 * g2) * inverse
    return ratio, square


@compiled
def _add_outer(local: Floats, left: Floats, right: Floats, factor: float) -> None:
    """Add factor left_a right_b^T to the blocks (a, b >= a) of ``local``, shape (3, 3, nodes, nodes)."""
    nodes = left.shape[1]
    for a in range(nodes):
        for i in range(3):
            scaled = factor * left[i, a]
            for k in range(3):
                for b in range(a, nodes):
                    local[i, k, a, b] += scaled * right[k, b]


@compiled
def _add_point(
    local: Floats,
    gradients: Floats,
    f: Floats,
    h: Floats,
    q: Floats,
    terms: tuple[float, float, float, float, float],
) -> None:
    """Add one point's tangent; terms multiply G.G 1, f h^T + h f^T, h_a h_b^T, h_b h_a^T and q q^T."""
    nodes = f.shape[1]
    unit, cross, straight, swapped, square = terms
    for a in range(nodes):
        g0, g1, g2 = unit * gradients[0, a], unit * gradients[1, a], unit * gradients[2, a]
        for i in range(3):
            of_f = cross * h[i, a]
            of_h = cross * f[i, a] + straight * h[i, a]
            of_q = square * q[i, a]
            for k in range(3):
                of_swap = swapped * h[k, a]
                for b in range(a, nodes):
                    local[i, k, a, b] += of_f * f[k, b] + of_h * h[k, b] + of_q * q[k, b] + of_swap * h[i, b]
            for b in range(a, nodes):
                local[i, i, a, b] += g0 * gradients[0, b] + g1 * gradients[1, b] + g2 * gradients[2, b]


@compiled
def scatter(local: Floats, slots: Slots, values: Floats) -> None:
    """Add the blocks (a, b >= a) of one element to the global blocks."""
    nodes = slots.shape[0]
    for a in range(nodes):
        for b in range(a, nodes):
            slot = slots[a, b]
            if slot >= 0:
                for i in range(3):
                    for k in range(3):
                        values[slot, i, k] += local[i, k, a, b]
            elif slot < -1:
                for i in range(3):
                    for k in range(3):
                        values[-2 - slot, k, i] += local[i, k, a, b]


@compiled
def solid_forces(  # noqa: C901 (one loop nest, compiled)
    positions: Floats,
    connectivity: Indices,
    gradients: Floats,
    weights: Floats,
    coefficients: Floats,
    scales: Floats,
    slots: Slots,
    forces: Floats,
    values: Floats,
    tangent: bool,
) -> bool:
    """Add internal forces and tangent blocks of all elements; see ``Solids.forces``."""
    points, nodes = gradients.shape[1], gradients.shape[3]
    corners = np.empty((3, nodes))
    f = np.empty((points, 3, nodes))
    h = np.empty((points, 3, nodes))
    q = np.empty((3, nodes))
    mean_slope = np.empty((3, nodes))
    force = np.empty((3, nodes))
    local = np.empty((3, 3, nodes, nodes))
    ratios = np.empty(points)
    squares = np.empty(points)
    for e in range(connectivity.shape[0]):
        for n in range(nodes):
            for i in range(3):
                corners[i, n] = positions[connectivity[e, n], i]
        volume = 0.0
        mean = 0.0
        mean_slope[:] = 0.0
        for p in range(points):
            ratios[p], squares[p] = _deform(corners, gradients[e, p], f[p], h[p])
            if not ratios[p] > 0.0:
                return False
            weight = weights[e, p]
            volume += weight
            mean += weight * ratios[p]
            mean_slope += (weight * ratios[p]) * h[p]
        mean /= volume
        code, half, bulk = coefficients[e, 0], scales[e] * coefficients[e, 1], scales[e] * coefficients[e, 2]
        a, b = coefficients[e, 3], coefficients[e, 4]
        pressure = 0.5 * bulk * (mean - 1.0 / mean)
        force[:] = pressure * mean_slope
        if tangent:
            local[:] = 0.0
            _add_outer(local, mean_slope, mean_slope, 0.5 * bulk * (1.0 + 1.0 / (mean * mean)) / volume)
        for p in range(points):
            weight, square = weights[e, p], squares[p]
            shrink = ratios[p] ** (-2.0 / 3.0)
            first, second = isochoric_slopes(code, half, a, b, shrink * square - 3.0)
            if not np.isfinite(first):
                return False
            for i in range(3):
                for n in range(nodes):
                    q[i, n] = shrink * (2.0 * f[p, i, n] - 2.0 / 3.0 * square * h[p, i, n])
                    force[i, n] += weight * first * q[i, n]
            if tangent:
                base = weight * first * shrink
                volumetric = pressure * weight * ratios[p]
                terms = (
                    2.0 * base,
                    -4.0 / 3.0 * base,
                    4.0 / 9.0 * base * square + volumetric,
                    2.0 / 3.0 * base * square - volumetric,
                    weight * second,
                )
                _add_point(local, gradients[e, p], f[p], h[p], q, terms)
        for n in range(nodes):
            for i in range(3):
                forces[connectivity[e, n], i] += force[i, n]
        if tangent:
            scatter(local, slots[e], values)
    return True
