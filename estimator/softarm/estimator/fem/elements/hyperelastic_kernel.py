"""Kernel of the hyperelastic elements.

With F the deformation gradient, J = det F, I = J^(-2/3) F:F, and for node a its rest gradient G_a,
f_a = F G_a and h_a = F^-T G_a, the derivatives of the isochoric energy psi(I) are

    d psi / d x_a        = psi' q_a,           q_a = J^(-2/3) (2 f_a - 2/3 F:F h_a)
    d2 psi / d x_a d x_b = psi'' q_a q_b^T + psi' J^(-2/3) [ 2 (G_a . G_b) 1 - 4/3 (f_a h_b^T + h_a f_b^T)
                           + 4/9 F:F h_a h_b^T + 2/3 F:F h_b h_a^T ]

and of the volumetric energies V U(m) and sum_q w_q P(J_q), m = sum_q w_q J_q / V, with b_a = sum_q w_q J h_a:

    U' b_a   and   U''/V b_a b_b^T + U' sum_q w_q J (h_a h_b^T - h_b h_a^T),
    sum_q w_q P' J h_a   and   sum_q w_q [(P'' J^2 + P' J) h_a h_b^T - P' J h_b h_a^T].

Four elements go through together, one per lane of a vector. The records that the pair loop streams through
are laid out for it: for each node and point f, h, G (``RIGHT``), and the combinations of them that multiply
those of the second node (``LEFT``).
"""

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.fem.compiled import compiled
from softarm.estimator.fem.linalg.pattern import Slots
from softarm.estimator.fem.linalg.simd import SIMD_WIDTH, fma, load, multiply, store, zero

# Bytes from one vector to the next, then the vectors of a record.
STEP = 8 * SIMD_WIDTH
RIGHT, LEFT = 9, 12


@compiled
def isochoric_slopes(code: float, half: float, a: float, b: float, excess: float) -> tuple[float, float]:
    """Compute psi' and psi'' at I - 3 = ``excess``; the laws stand in ``Material``."""
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
def fill_gradient(corners: int, gradients: int, nodes: int, points: int, p: int, out: int) -> None:
    """Fill the deformation gradients of four elements at point p, shape (9, lanes) at address ``out``."""
    f00, f01, f02 = zero(), zero(), zero()
    f10, f11, f12 = zero(), zero(), zero()
    f20, f21, f22 = zero(), zero(), zero()
    for n in range(nodes):
        x, g = corners + 3 * n * STEP, gradients + (n * points + p) * 3 * STEP
        x0, x1, x2 = load(x), load(x + STEP), load(x + 2 * STEP)
        g0, g1, g2 = load(g), load(g + STEP), load(g + 2 * STEP)
        f00, f01, f02 = fma(x0, g0, f00), fma(x0, g1, f01), fma(x0, g2, f02)
        f10, f11, f12 = fma(x1, g0, f10), fma(x1, g1, f11), fma(x1, g2, f12)
        f20, f21, f22 = fma(x2, g0, f20), fma(x2, g1, f21), fma(x2, g2, f22)
    store(out, f00)
    store(out + STEP, f01)
    store(out + 2 * STEP, f02)
    store(out + 3 * STEP, f10)
    store(out + 4 * STEP, f11)
    store(out + 5 * STEP, f12)
    store(out + 6 * STEP, f20)
    store(out + 7 * STEP, f21)
    store(out + 8 * STEP, f22)


@compiled
def invert_simd_element(F: Floats, inverse: Floats, lane: int) -> tuple[float, float]:
    """Fill the transposed inverse of one lane's 3 x 3 matrix, both of shape (9, lanes); return J and F:F."""
    square = 0.0
    for i in range(3):
        for k in range(3):
            m, n = 3 * ((i + 1) % 3), 3 * ((i + 2) % 3)
            o, r = (k + 1) % 3, (k + 2) % 3
            inverse[3 * i + k, lane] = F[m + o, lane] * F[n + r, lane] - F[m + r, lane] * F[n + o, lane]
            square += F[3 * i + k, lane] * F[3 * i + k, lane]
    ratio = F[0, lane] * inverse[0, lane] + F[1, lane] * inverse[1, lane] + F[2, lane] * inverse[2, lane]
    for m in range(9):
        inverse[m, lane] /= ratio
    return ratio, square


@compiled
def _rows(matrix: int, vector: int, out: int) -> None:
    """Fill matrix @ vector, four at a time."""
    v0, v1, v2 = load(vector), load(vector + STEP), load(vector + 2 * STEP)
    for i in range(3):
        m = matrix + 3 * i * STEP
        store(out + i * STEP, fma(load(m), v0, fma(load(m + STEP), v1, multiply(load(m + 2 * STEP), v2))))


@compiled
def _left(right: int, terms: int, left: int) -> None:
    """Fill the first node's record of one point from its f, h, G.

    The record holds 4c f + m h, m f + s h, t h and u G with the terms u, 4c, m, s, t at address ``terms``.
    """
    unit, curving, mixed = load(terms), load(terms + STEP), load(terms + 2 * STEP)
    straight, transposed = load(terms + 3 * STEP), load(terms + 4 * STEP)
    for i in range(3):
        f, h = load(right + i * STEP), load(right + (3 + i) * STEP)
        store(left + i * STEP, fma(curving, f, multiply(mixed, h)))
        store(left + (3 + i) * STEP, fma(mixed, f, multiply(straight, h)))
        store(left + (6 + i) * STEP, multiply(transposed, h))
        store(left + (9 + i) * STEP, multiply(unit, load(right + (6 + i) * STEP)))


@compiled
def _pair(left: int, right: int, first: int, second: int, hourglass: int, points: int, out: int) -> None:
    """Fill the blocks of a pair of nodes of four elements, shape (9, lanes) at address ``out``.

    With the records X, Y, T, U of the first node and f, h, G of the second, and b the mean volume's slopes,
    the block is sum_q [U.G 1 + X f^T + Y h^T + h T^T] + b_first b_second^T; its part along the diagonal goes
    apart, with that of the hourglass stiffness added.
    """
    a0, a1, a2 = load(first), load(first + STEP), load(first + 2 * STEP)
    b0, b1, b2 = load(second), load(second + STEP), load(second + 2 * STEP)
    k00, k01, k02 = multiply(a0, b0), multiply(a0, b1), multiply(a0, b2)
    k10, k11, k12 = multiply(a1, b0), multiply(a1, b1), multiply(a1, b2)
    k20, k21, k22 = multiply(a2, b0), multiply(a2, b1), multiply(a2, b2)
    unit = load(hourglass)
    for p in range(points):
        x, r = left + p * LEFT * STEP, right + p * RIGHT * STEP
        f0, f1, f2 = load(r), load(r + STEP), load(r + 2 * STEP)
        x0, x1, x2 = load(x), load(x + STEP), load(x + 2 * STEP)
        k00, k01, k02 = fma(x0, f0, k00), fma(x0, f1, k01), fma(x0, f2, k02)
        k10, k11, k12 = fma(x1, f0, k10), fma(x1, f1, k11), fma(x1, f2, k12)
        k20, k21, k22 = fma(x2, f0, k20), fma(x2, f1, k21), fma(x2, f2, k22)
        h0, h1, h2 = load(r + 3 * STEP), load(r + 4 * STEP), load(r + 5 * STEP)
        y0, y1, y2 = load(x + 3 * STEP), load(x + 4 * STEP), load(x + 5 * STEP)
        k00, k01, k02 = fma(y0, h0, k00), fma(y0, h1, k01), fma(y0, h2, k02)
        k10, k11, k12 = fma(y1, h0, k10), fma(y1, h1, k11), fma(y1, h2, k12)
        k20, k21, k22 = fma(y2, h0, k20), fma(y2, h1, k21), fma(y2, h2, k22)
        t0, t1, t2 = load(x + 6 * STEP), load(x + 7 * STEP), load(x + 8 * STEP)
        k00, k01, k02 = fma(h0, t0, k00), fma(h0, t1, k01), fma(h0, t2, k02)
        k10, k11, k12 = fma(h1, t0, k10), fma(h1, t1, k11), fma(h1, t2, k12)
        k20, k21, k22 = fma(h2, t0, k20), fma(h2, t1, k21), fma(h2, t2, k22)
        unit = fma(load(x + 9 * STEP), load(r + 6 * STEP), unit)
        unit = fma(load(x + 10 * STEP), load(r + 7 * STEP), unit)
        unit = fma(load(x + 11 * STEP), load(r + 8 * STEP), unit)
    store(out, k00)
    store(out + STEP, k01)
    store(out + 2 * STEP, k02)
    store(out + 3 * STEP, k10)
    store(out + 4 * STEP, k11)
    store(out + 5 * STEP, k12)
    store(out + 6 * STEP, k20)
    store(out + 7 * STEP, k21)
    store(out + 8 * STEP, k22)
    store(out + 9 * STEP, unit)


@compiled
def _scatter(block: Floats, slots: Slots, values: Floats) -> None:
    """Add the blocks of a pair of nodes, shape (10, lanes), of which the last row goes on the diagonal."""
    for lane in range(SIMD_WIDTH):
        slot = slots[lane]
        unit = block[9, lane]
        if slot >= 0:
            for i in range(3):
                for k in range(3):
                    values[slot, i, k] += block[3 * i + k, lane]
                values[slot, i, i] += unit
        # The pair is stored the other way round, as its transpose.
        elif slot < -1:
            for i in range(3):
                for k in range(3):
                    values[-2 - slot, k, i] += block[3 * i + k, lane]
                values[-2 - slot, i, i] += unit


@compiled
def evaluate_law(
    weights: Floats, ratios: Floats, squares: Floats, table: Floats, scales: Floats, of_f: Floats,
    of_h: Floats, volume_slope: Floats, terms: Floats, stiffening: Floats
) -> bool:  # fmt: skip
    """Evaluate the law of four elements at all points.

    Args:
        weights: Volumes of the points, shape (points, lanes).
        ratios: J, shape (points, lanes).
        squares: F:F, shape (points, lanes).
        table: ``Solids.coefficients``, shape (lanes, 6).
        scales: Factors on the stiffness, shape (lanes,).
        of_f: Filled with the factor of f in the force, shape (points, lanes).
        of_h: Filled with the factor of h in the force, shape (points, lanes).
        volume_slope: Filled with w J, shape (points, lanes).
        terms: Filled with the terms of ``_left``, shape (points, 5, lanes).
        stiffening: Filled with the square root of U''/V, shape (lanes,).

    Returns:
        Whether the law is defined at every point.
    """
    for lane in range(SIMD_WIDTH):
        volume, mean = 0.0, 0.0
        for p in range(weights.shape[0]):
            volume += weights[p, lane]
            mean += weights[p, lane] * ratios[p, lane]
        mean /= volume
        code, a, b = table[lane, 0], table[lane, 3], table[lane, 4]
        half, bulk = scales[lane] * table[lane, 1], scales[lane] * table[lane, 2]
        local = scales[lane] * table[lane, 5]
        pressure = 0.5 * bulk * (mean - 1.0 / mean)
        # Its root goes into either factor of b_a b_b^T, which is then one product of like vectors.
        stiffening[lane] = np.sqrt(0.5 * bulk * (1.0 + 1.0 / (mean * mean)) / volume)
        for p in range(weights.shape[0]):
            weight, square = weights[p, lane], squares[p, lane]
            shrink = ratios[p, lane] ** (-2.0 / 3.0)
            first, second = isochoric_slopes(code, half, a, b, shrink * square - 3.0)
            # Gent's law is stretched beyond its limit.
            if not np.isfinite(first):
                return False
            base, curving = weight * first * shrink, weight * second * shrink * shrink
            ratio = ratios[p, lane]
            volumetric = weight * (pressure * ratio + 0.5 * local * (ratio * ratio - 1.0))
            # Factors of the products in the second derivative of psi, as at the head of this file.
            bent = base + curving * square
            of_f[p, lane] = 2.0 * base
            of_h[p, lane] = volumetric - 2.0 / 3.0 * base * square
            volume_slope[p, lane] = weight * ratios[p, lane]
            terms[p, 0, lane] = 2.0 * base
            terms[p, 1, lane] = 4.0 * curving
            terms[p, 2, lane] = -4.0 / 3.0 * bent
            stiff = 0.5 * local * weight * (ratio * ratio + 1.0)
            terms[p, 3, lane] = 4.0 / 9.0 * square * bent + volumetric + stiff
            terms[p, 4, lane] = 2.0 / 3.0 * base * square - volumetric
    return True


@compiled
def collect_corners(positions: Floats, connectivity: Indices, corners: Floats) -> None:
    """Fill the positions of the nodes of four elements, shape (nodes, 3, lanes)."""
    for n in range(corners.shape[0]):
        for lane in range(SIMD_WIDTH):
            node = max(connectivity[lane, n], -1 - connectivity[lane, n])
            for i in range(3):
                corners[n, i, lane] = positions[node, i]


@compiled
def _add_stress(stress: int, gradients: int, nodes: int, points: int, forces: int) -> None:
    """Add the forces P G_n of one point of four elements to theirs, shape (nodes, 3, lanes)."""
    p00, p01, p02 = load(stress), load(stress + STEP), load(stress + 2 * STEP)
    p10, p11, p12 = load(stress + 3 * STEP), load(stress + 4 * STEP), load(stress + 5 * STEP)
    p20, p21, p22 = load(stress + 6 * STEP), load(stress + 7 * STEP), load(stress + 8 * STEP)
    for n in range(nodes):
        g, out = gradients + 3 * n * points * STEP, forces + 3 * n * STEP
        g0, g1, g2 = load(g), load(g + STEP), load(g + 2 * STEP)
        store(out, fma(p00, g0, fma(p01, g1, fma(p02, g2, load(out)))))
        store(out + STEP, fma(p10, g0, fma(p11, g1, fma(p12, g2, load(out + STEP)))))
        store(out + 2 * STEP, fma(p20, g0, fma(p21, g1, fma(p22, g2, load(out + 2 * STEP)))))


@compiled
def _hold_hourglass(hourglass: int, corners: int, scale: int, nodes: int, forces: int) -> None:
    """Fill the forces of the hourglass stiffness of four elements, shape (nodes, 3, lanes)."""
    factor = load(scale)
    for n in range(nodes):
        f0, f1, f2 = zero(), zero(), zero()
        for m in range(nodes):
            stiffness, x = load(hourglass + (n * nodes + m) * STEP), corners + 3 * m * STEP
            f0 = fma(stiffness, load(x), f0)
            f1 = fma(stiffness, load(x + STEP), f1)
            f2 = fma(stiffness, load(x + 2 * STEP), f2)
        out = forces + 3 * n * STEP
        store(out, multiply(factor, f0))
        store(out + STEP, multiply(factor, f1))
        store(out + 2 * STEP, multiply(factor, f2))


@compiled
def _fill_records(
    deformation: Floats, inverse: Floats, gradients: Floats, terms: Floats, right: Floats, left: Floats
) -> None:
    """Fill the records of all nodes at all points of four elements: f, h, G and their combinations."""
    for n in range(right.shape[0]):
        for p in range(right.shape[1]):
            record, g = right[n, p].ctypes.data, gradients[n, p].ctypes.data
            _rows(deformation[p].ctypes.data, g, record)
            _rows(inverse[p].ctypes.data, g, record + 3 * STEP)
            for i in range(3):
                store(record + (6 + i) * STEP, load(g + i * STEP))
            _left(record, terms[p].ctypes.data, left[n, p].ctypes.data)


@compiled
def _fill_mean_slopes(right: Floats, slope: Floats, stiffening: Floats, mean_slope: Floats) -> None:
    """Fill sqrt(U'' / V) sum_q w_q J h_n of four elements, shape (nodes, 3, lanes)."""
    for n in range(right.shape[0]):
        for i in range(3):
            volume = zero()
            for p in range(right.shape[1]):
                h = load(right[n, p].ctypes.data + (3 + i) * STEP)
                volume = fma(load(slope[p].ctypes.data), h, volume)
            store(mean_slope[n, i].ctypes.data, multiply(load(stiffening.ctypes.data), volume))


@compiled
def _add_forces(connectivity: Indices, force: Floats, forces: Floats) -> None:
    """Add the forces of four elements, shape (nodes, 3, lanes), to the nodes, padding left out."""
    for n in range(force.shape[0]):
        for lane in range(SIMD_WIDTH):
            node = connectivity[lane, n]
            if node >= 0:
                for i in range(3):
                    forces[node, i] += force[n, i, lane]


@compiled
def solid_forces(
    positions: Floats,
    connectivity: Indices,
    gradients: Floats,
    weights: Floats,
    coefficients: Floats,
    scales: Floats,
    hourglass: Floats,
    slots: Slots,
    forces: Floats,
    values: Floats,
    tangent: bool,
) -> bool:
    """Add internal forces and, where wanted, tangent blocks of all elements; see ``Solids.forces``.

    The arrays of the elements are those of ``Batches``; ``scales`` has shape (batches, lanes). The forces
    come from the stresses P = 2 c F + d F^-T of the points, so that they cost little where no tangent is
    wanted.
    """
    nodes, points = gradients.shape[1], gradients.shape[2]
    corners, force = np.empty((nodes, 3, SIMD_WIDTH)), np.empty((nodes, 3, SIMD_WIDTH))
    deformation, inverse = np.empty((points, 9, SIMD_WIDTH)), np.empty((points, 9, SIMD_WIDTH))
    ratios, squares = np.empty((points, SIMD_WIDTH)), np.empty((points, SIMD_WIDTH))
    of_f, of_h, slope = (
        np.empty((points, SIMD_WIDTH)),
        np.empty((points, SIMD_WIDTH)),
        np.empty((points, SIMD_WIDTH)),
    )
    terms, stiffening, scale = np.empty((points, 5, SIMD_WIDTH)), np.empty(SIMD_WIDTH), np.empty(SIMD_WIDTH)
    stress, block = np.empty((9, SIMD_WIDTH)), np.empty((10, SIMD_WIDTH))
    # The records of the tangent are far larger than all else; they are not allocated for nothing.
    kept = nodes if tangent else 0
    right, left = np.empty((kept, points, RIGHT, SIMD_WIDTH)), np.empty((kept, points, LEFT, SIMD_WIDTH))
    mean_slope, stiffness = np.empty((kept, 3, SIMD_WIDTH)), np.empty(SIMD_WIDTH)
    for e in range(connectivity.shape[0]):
        collect_corners(positions, connectivity[e], corners)
        x, g, f = corners.ctypes.data, gradients[e].ctypes.data, force.ctypes.data
        positive = True
        for p in range(points):
            fill_gradient(x, g, nodes, points, p, deformation[p].ctypes.data)
            for lane in range(SIMD_WIDTH):
                ratios[p, lane], squares[p, lane] = invert_simd_element(deformation[p], inverse[p], lane)
                positive &= ratios[p, lane] > 0.0  # neither is what is not a number
        if not positive:
            return False
        if not evaluate_law(
            weights[e], ratios, squares, coefficients[e], scales[e], of_f, of_h, slope, terms, stiffening
        ):
            return False
        scale[:] = scales[e]
        _hold_hourglass(hourglass[e].ctypes.data, x, scale.ctypes.data, nodes, f)
        for p in range(points):
            for k in range(9):
                for lane in range(SIMD_WIDTH):
                    straight = of_f[p, lane] * deformation[p, k, lane]
                    stress[k, lane] = straight + of_h[p, lane] * inverse[p, k, lane]
            _add_stress(stress.ctypes.data, g + 3 * p * STEP, nodes, points, f)
        _add_forces(connectivity[e], force, forces)
        if not tangent:
            continue
        _fill_records(deformation, inverse, gradients[e], terms, right, left)
        _fill_mean_slopes(right, slope, stiffening, mean_slope)
        for n in range(nodes):
            first, x_n = mean_slope[n].ctypes.data, left[n].ctypes.data
            # Half of the pairs; the slots determine which of the two orders is stored.
            for m in range(n, nodes):
                held = multiply(load(scale.ctypes.data), load(hourglass[e, n, m].ctypes.data))
                store(stiffness.ctypes.data, held)
                second, y_m = mean_slope[m].ctypes.data, right[m].ctypes.data
                _pair(x_n, y_m, first, second, stiffness.ctypes.data, points, block.ctypes.data)
                _scatter(block, slots[e, n, m], values)
    return True
