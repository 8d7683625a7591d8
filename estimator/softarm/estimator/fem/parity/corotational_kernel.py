"""Kernel of the co-rotational tetrahedra.

With R the element's rotation since rest, K its linear stiffness, X and x the corners less the first,

    f_a = R sum_b K_ab (R^T x_b - X_b),   d f_a = sum_b K'_ab dx_b + (sum_b K'_ab [x_b] - [f_a]) w,

where K' = R K R^T, [v] is the cross-product matrix and w = sum_c W_c dx_c the spin of the frame. For a polar
frame of A = sum_a x_a c_a^T = R U, w = R (tr U - U)^-1 sum_a c_a x (R^T dx_a).
"""

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.fem.compiled import compiled
from softarm.estimator.fem.linalg.pattern import Slots
from softarm.estimator.fem.linalg.small import invert_matrix, polar_rotation


@compiled
def _frame(corners: Floats, rule: int, fit: Floats, frame: Floats, stretch: Floats, work: Floats) -> None:
    """Fill the element's frame and, for a polar rule, the stretch U, both of shape (3, 3)."""
    if rule == 0:
        for i in range(3):
            for k in range(3):
                frame[i, k] = 1.0 if i == k else 0.0
        return
    if rule == 1:
        first, second = corners[1] - corners[0], corners[2] - corners[0]
        frame[:, 0] = first / np.sqrt((first * first).sum())
        normal = np.cross(first, second)
        frame[:, 2] = normal / np.sqrt((normal * normal).sum())
        frame[:, 1] = np.cross(frame[:, 2], frame[:, 0])
        return
    matrix = np.zeros((3, 3))
    for a in range(4):
        for i in range(3):
            for k in range(3):
                matrix[i, k] += corners[a, i] * fit[a, k]
    polar_rotation(matrix, frame, work)
    for i in range(3):
        for k in range(3):
            stretch[i, k] = 0.0
            for m in range(3):
                stretch[i, k] += frame[m, i] * matrix[m, k]


@compiled
def _spin(corners: Floats, rule: int, fit: Floats, frame: Floats, stretch: Floats, spin: Floats) -> None:
    """Fill the matrices W_a of the frame's spin w = sum_a W_a dx_a, shape (4, 3, 3)."""
    spin[:] = 0.0
    if rule == 0:
        return
    if rule == 1:
        length, along, height = 0.0, 0.0, 0.0
        for i in range(3):
            length += (corners[1, i] - corners[0, i]) * frame[i, 0]
            along += (corners[2, i] - corners[0, i]) * frame[i, 0]
            height += (corners[2, i] - corners[0, i]) * frame[i, 1]
        for i in range(3):
            for k in range(3):
                tilt = -frame[i, 1] * frame[k, 2] + frame[i, 2] * frame[k, 1]
                spin[1, i, k] = (tilt - along / height * frame[i, 0] * frame[k, 2]) / length
                spin[2, i, k] = frame[i, 0] * frame[k, 2] / height
                spin[0, i, k] = -spin[1, i, k] - spin[2, i, k]
        return
    trace = stretch[0, 0] + stretch[1, 1] + stretch[2, 2]
    system = np.empty((3, 3))
    solved = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            system[i, k] = (trace if i == k else 0.0) - stretch[i, k]
    invert_matrix(system, solved)
    left = frame @ solved
    cross = np.zeros((3, 3))
    for a in range(4):
        cross[0, 1], cross[0, 2], cross[1, 2] = -fit[a, 2], fit[a, 1], -fit[a, 0]
        cross[1, 0], cross[2, 0], cross[2, 1] = fit[a, 2], -fit[a, 1], fit[a, 0]
        spin[a] = left @ cross @ frame.T


@compiled
def tetrahedron_rotations(
    positions: Floats, connectivity: Indices, frame: Indices, fit: Floats, rest_frame: Floats
) -> Floats:
    """Compute each element's rotation since its rest frame, shape (elements, 3, 3)."""
    rotations = np.empty((connectivity.shape[0], 3, 3))
    corners = np.empty((4, 3))
    current, stretch, work = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for e in range(connectivity.shape[0]):
        for a in range(4):
            corners[a] = positions[connectivity[e, a]]
        _frame(corners, frame[e], fit[e], current, stretch, work)
        rotations[e] = current @ rest_frame[e].T
    return rotations


@compiled
def _add_tangent(  # noqa: C901 (one loop nest, compiled)
    turned: Floats, corners: Floats, force: Floats, spin: Floats, slots: Slots, values: Floats, mirror: Floats
) -> None:
    """Add one element's tangent; ``turned`` holds K', shape (4, 4, 3, 3), ``force`` f, shape (4, 3)."""
    lever = np.empty((3, 3))
    block = np.empty((3, 3))
    for a in range(4):
        for i in range(3):
            for k in range(3):
                m, n = (k + 1) % 3, (k + 2) % 3
                total = 0.0
                for b in range(1, 4):
                    dx_m, dx_n = corners[b, m] - corners[0, m], corners[b, n] - corners[0, n]
                    total += turned[a, b, i, m] * dx_n - turned[a, b, i, n] * dx_m
                lever[i, k] = total
        lever[0, 1] += force[a, 2]
        lever[0, 2] -= force[a, 1]
        lever[1, 0] -= force[a, 2]
        lever[1, 2] += force[a, 0]
        lever[2, 0] += force[a, 1]
        lever[2, 1] -= force[a, 0]
        for b in range(4):
            slot = slots[a, b]
            if slot == -1:
                continue
            for i in range(3):
                for k in range(3):
                    block[i, k] = turned[a, b, i, k]
                    for m in range(3):
                        block[i, k] += lever[i, m] * spin[b, m, k]
            if a == b:
                for i in range(3):
                    for k in range(3):
                        values[slot, i, k] += block[i, k]
                        mirror[slot, k, i] += block[i, k]
            elif slot >= 0:
                for i in range(3):
                    for k in range(3):
                        values[slot, i, k] += block[i, k]
            else:
                for i in range(3):
                    for k in range(3):
                        mirror[-2 - slot, k, i] += block[i, k]


@compiled
def tetrahedron_forces(  # noqa: C901 (one loop nest, compiled)
    positions: Floats,
    connectivity: Indices,
    rest: Floats,
    stiffness: Floats,
    frame: Indices,
    fit: Floats,
    rest_frame: Floats,
    scales: Floats,
    slots: Slots,
    forces: Floats,
    values: Floats,
    mirror: Floats,
    tangent: bool,
) -> bool:
    """Add internal forces and tangent blocks of all elements; see ``Tetrahedra.forces``."""
    corners, local = np.empty((4, 3)), np.empty(12)
    current, stretch, work = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    rotation, product = np.empty((3, 3)), np.empty((3, 3))
    spin, turned, force = np.empty((4, 3, 3)), np.empty((4, 4, 3, 3)), np.empty((4, 3))
    for e in range(connectivity.shape[0]):
        for a in range(4):
            for i in range(3):
                corners[a, i] = positions[connectivity[e, a], i]
        _frame(corners, frame[e], fit[e], current, stretch, work)
        for i in range(3):
            for k in range(3):
                rotation[i, k] = 0.0
                for m in range(3):
                    rotation[i, k] += current[i, m] * rest_frame[e, k, m]
        for a in range(4):
            for i in range(3):
                local[3 * a + i] = -rest[e, a, i]
                for m in range(3):
                    local[3 * a + i] += rotation[m, i] * (corners[a, m] - corners[0, m])
        for a in range(4):
            for i in range(3):
                work[0, i] = 0.0
                for m in range(12):
                    work[0, i] += stiffness[e, 3 * a + i, m] * local[m]
            for i in range(3):
                total = 0.0
                for m in range(3):
                    total += rotation[i, m] * work[0, m]
                force[a, i] = scales[e] * total
                forces[connectivity[e, a], i] += force[a, i]
                if not np.isfinite(total):
                    return False
        if not tangent:
            continue
        for a in range(4):
            for b in range(4):
                for i in range(3):
                    for k in range(3):
                        product[i, k] = 0.0
                        for m in range(3):
                            product[i, k] += stiffness[e, 3 * a + i, 3 * b + m] * rotation[k, m]
                for i in range(3):
                    for k in range(3):
                        total = 0.0
                        for m in range(3):
                            total += rotation[i, m] * product[m, k]
                        turned[a, b, i, k] = scales[e] * total
        _spin(corners, frame[e], fit[e], current, stretch, spin)
        _add_tangent(turned, corners, force, spin, slots[e], values, mirror)
    return True
