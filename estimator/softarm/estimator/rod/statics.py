"""Statics of the chain of links, compiled.

Station 0 is the clamp; link i joins stations i and i + 1. Its strain is (theta, t): with R, x a station's
frame and l the link's rest length,

    R_mid = R_i exp(theta / 2),  R_{i+1} = R_i exp(theta),  x_{i+1} = x_i + R_mid (l e_z + t).

The link's wrench is the mean over its length of the force and moment in its cross-sections, in R_mid about
the middle of its chord. Actions (point loads, and each link's weight) sit on a station or at a share s of a
link. Inside its own link an action counts by the part of its moment that is linear along the link (least
squares): a lateral force by 3 s^2 - 2 s^3, an axial one by s, its moment by l s^2 / 2.
"""

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats
from softarm.estimator.rod.arrays import Actions, ChainInputs
from softarm.estimator.rotations import exp_kernel, quaternion_kernel, rotation_vector_kernel
from softarm.estimator.vectors import add_rotated, add_rotated_back, cross, multiply, rotate, rotate_back


@njit(cache=True, nogil=True)
def place(strain: Floats, length: Floats, rotations: Floats, positions: Floats, middles: Floats) -> None:
    """Place the stations of strained links.

    Args:
        strain: theta [rad] and t [m], shape (links, 6).
        length: Rest lengths [m], shape (links,).
        rotations: Filled; station 0 is given, shape (links + 1, 3, 3).
        positions: Filled; station 0 is given [m], shape (links + 1, 3).
        middles: Filled with R_mid, shape (links, 3, 3).
    """
    links = len(length)
    half, rotation = np.empty((1, 3)), np.empty((1, 3, 3))
    chord = np.empty(3)
    for i in range(links):
        for k in range(3):
            half[0, k] = 0.5 * strain[i, k]
            chord[k] = strain[i, 3 + k]
            positions[i + 1, k] = positions[i, k]
        chord[2] += length[i]
        exp_kernel(half, rotation)
        multiply(rotations[i], rotation[0], middles[i])
        multiply(middles[i], rotation[0], rotations[i + 1])
        add_rotated(middles[i], chord, positions[i + 1])


@njit(cache=True, nogil=True)
def strain_between(
    rotations: Floats, positions: Floats, length: Floats, strain: Floats, middles: Floats
) -> None:
    """Fill strain, shape (links, 6), and R_mid from stations: the inverse of ``place``."""
    half, rotation = np.empty((1, 3)), np.empty((1, 3, 3))
    relative, quaternion, vector = np.empty((1, 3, 3)), np.empty((1, 4)), np.empty((1, 3))
    chord = np.empty(3)
    for i in range(len(length)):
        multiply(rotations[i].T, rotations[i + 1], relative[0])
        quaternion_kernel(relative, quaternion)
        rotation_vector_kernel(quaternion, vector)
        for k in range(3):
            strain[i, k] = vector[0, k]
            half[0, k] = 0.5 * vector[0, k]
        exp_kernel(half, rotation)
        multiply(rotations[i], rotation[0], middles[i])
        for k in range(3):
            chord[k] = positions[i + 1, k] - positions[i, k]
        rotate_back(middles[i], chord, strain[i, 3:6])
        strain[i, 5] -= length[i]


@njit(cache=True, nogil=True)
def action_points(
    strain: Floats, length: Floats, rotations: Floats, positions: Floats, actions: Actions, points: Floats
) -> None:
    """Fill the places of the actions [m], shape (actions, 3).

    An action with share 1 sits on its link's far station, at an offset in that station's frame; one with
    a smaller share s on the link's arc, x_i + R_i exp(s theta / 2) s (l e_z + t).
    """
    part, rotation = np.empty((1, 3)), np.empty((1, 3, 3))
    chord, moved = np.empty(3), np.empty(3)
    for a in range(len(actions.link)):
        i, s = actions.link[a], actions.share[a]
        station = i + 1 if s >= 1.0 else i
        for k in range(3):
            points[a, k] = positions[station, k]
        if s >= 1.0:
            add_rotated(rotations[station], actions.offset[a], points[a])
            continue
        for k in range(3):
            part[0, k] = 0.5 * s * strain[i, k]
            chord[k] = s * strain[i, 3 + k]
        chord[2] += s * length[i]
        exp_kernel(part, rotation)
        rotate(rotation[0], chord, moved)
        add_rotated(rotations[i], moved, points[a])


@njit(cache=True, nogil=True)
def add_part(beta: Floats, middle: Floats, force: Floats, couple: Floats, wrench: Floats) -> None:
    """Add to a link's wrench (force, moment), shape (6,), what an action inside it contributes.

    Args:
        beta: Weights of lateral force, axial force, moment of the force [m], couple, and shear per
            couple [1/m], shape (5,).
        middle: R_mid, shape (3, 3).
        force: Force in the base frame [N], shape (3,).
        couple: Couple in the base frame [N m], shape (3,).
        wrench: Added to, shape (6,).
    """
    f, c = np.empty(3), np.empty(3)
    rotate_back(middle, force, f)
    rotate_back(middle, couple, c)
    # A moment that changes along the link is a shear: dM_y/dz = -F_x, dM_x/dz = F_y.
    wrench[0] += beta[0] * f[0] + beta[4] * c[1]
    wrench[1] += beta[0] * f[1] - beta[4] * c[0]
    wrench[2] += beta[1] * f[2]
    # Of a force at a height: e_z x f = (-f_y, f_x, 0).
    wrench[3] += beta[3] * c[0] - beta[2] * f[1]
    wrench[4] += beta[3] * c[1] + beta[2] * f[0]
    wrench[5] += beta[3] * c[2]


@njit(cache=True, nogil=True)
def wrenches(
    positions: Floats,
    middles: Floats,
    actions: Actions,
    points: Floats,
    drive: ChainInputs,
    wrench: Floats,
    beyond: Floats,
) -> None:
    """Fill the links' wrenches, tip to base.

    Args:
        positions: Stations [m], shape (links + 1, 3).
        middles: R_mid, shape (links, 3, 3).
        actions: Where loads act.
        points: Places of the actions [m], shape (actions, 3).
        drive: Forces and couples of the actions.
        wrench: Filled with (force, moment) in R_mid, shape (links, 6).
        beyond: Filled with the sums over actions beyond each link: force F (3), moment about the base
            frame's origin (3), and sum x F^T (9), shape (links, 15).
    """
    links = len(middles)
    wrench.fill(0.0)
    beyond.fill(0.0)
    arm, moment = np.empty(3), np.empty(3)
    for a in range(len(actions.link)):
        i = actions.link[a]
        if actions.share[a] < 1.0:
            add_part(actions.beta[a], middles[i], drive.force[a], drive.couple[a], wrench[i])
            i -= 1
        if i >= 0:
            _add_beyond(points[a], drive.force[a], drive.couple[a], beyond[i])
    # Tip to base: what acts beyond the next link acts beyond this one as well.
    for i in range(links - 2, -1, -1):
        for k in range(15):
            beyond[i, k] += beyond[i + 1, k]
    for i in range(links):
        for k in range(3):
            arm[k] = 0.5 * (positions[i, k] + positions[i + 1, k])
        cross(arm, beyond[i, 0:3], moment)
        for k in range(3):
            moment[k] = beyond[i, 3 + k] - moment[k]
        add_rotated_back(middles[i], beyond[i, 0:3], wrench[i, 0:3])
        add_rotated_back(middles[i], moment, wrench[i, 3:6])


@njit(cache=True, nogil=True)
def _add_beyond(point: Floats, force: Floats, couple: Floats, beyond: Floats) -> None:
    """Add an action to the sums over all beyond a link, shape (15,)."""
    moment = np.empty(3)
    cross(point, force, moment)
    for k in range(3):
        beyond[k] += force[k]
        beyond[3 + k] += moment[k] + couple[k]
        for m in range(3):
            beyond[6 + 3 * k + m] += point[k] * force[m]
