"""Kernel of the hyperelastic elements' forces alone; the laws and symbols are those of ``solids_kernel``."""

import numpy as np

from softarm.estimator.fem.compiled import compiled
from softarm.estimator.fem.lanes import LANES, fma, load, multiply, store, zero
from softarm.estimator.fem.solids_kernel import (
    STEP,
    collect_corners,
    evaluate_law,
    fill_gradient,
    invert_lane,
)
from softarm.estimator.mesh import Floats, Indices


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
def solid_residual(  # noqa: C901 (one loop nest, compiled)
    positions: Floats,
    connectivity: Indices,
    gradients: Floats,
    weights: Floats,
    coefficients: Floats,
    scales: Floats,
    hourglass: Floats,
    forces: Floats,
) -> bool:
    """Add what ``solid_forces`` adds to the forces, by the stresses P = 2 c F + d F^-T of the points."""
    nodes, points = gradients.shape[1], gradients.shape[2]
    corners, force = np.empty((nodes, 3, LANES)), np.empty((nodes, 3, LANES))
    deformation, inverse = np.empty((points, 9, LANES)), np.empty((points, 9, LANES))
    ratios, squares = np.empty((points, LANES)), np.empty((points, LANES))
    of_f, of_h, slope = np.empty((points, LANES)), np.empty((points, LANES)), np.empty((points, LANES))
    terms, unused, scale = np.empty((points, 5, LANES)), np.empty(LANES), np.empty(LANES)
    for e in range(connectivity.shape[0]):
        collect_corners(positions, connectivity[e], corners)
        x, g, f = corners.ctypes.data, gradients[e].ctypes.data, force.ctypes.data
        least = np.inf
        for p in range(points):
            fill_gradient(x, g, nodes, points, p, deformation[p].ctypes.data)
            for lane in range(LANES):
                ratios[p, lane], squares[p, lane] = invert_lane(deformation[p], inverse[p], lane)
                if not ratios[p, lane] >= least:
                    least = ratios[p, lane]
        if not least > 0.0:
            return False
        if not evaluate_law(
            weights[e], ratios, squares, coefficients[e], scales[e], of_f, of_h, slope, terms, unused
        ):
            return False
        for lane in range(LANES):
            scale[lane] = scales[e, lane]
        _hold_hourglass(hourglass[e].ctypes.data, x, scale.ctypes.data, nodes, f)
        for p in range(points):
            for k in range(9):
                for lane in range(LANES):
                    straight = of_f[p, lane] * deformation[p, k, lane]
                    deformation[p, k, lane] = straight + of_h[p, lane] * inverse[p, k, lane]
            _add_stress(deformation[p].ctypes.data, g + 3 * p * STEP, nodes, points, f)
        for n in range(nodes):
            for lane in range(LANES):
                node = connectivity[e, lane, n]
                if node >= 0:
                    for i in range(3):
                        forces[node, i] += force[n, i, lane]
    return True
