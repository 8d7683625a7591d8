"""Derivatives of the chain's statics, compiled; symbols as in ``statics``."""

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats
from softarm.estimator.rod.arrays import Actions, ChainInputs
from softarm.estimator.rod.statics import add_part
from softarm.estimator.rotations import exp_kernel, jacobian_kernel
from softarm.estimator.vectors import add_rotated_back, cross, rotate, rotate_back


@njit(cache=True, nogil=True)
def link_motion(
    strain: Floats, rotation: Floats, middle: Floats, chord: Floats, far: Floats, motion: Floats
) -> None:
    """Fill the motion that each strain of a link causes.

    Args:
        strain: theta and t, shape (6,).
        rotation: R of the near station, shape (3, 3).
        middle: R_mid, shape (3, 3).
        chord: Far less near station [m], shape (3,).
        far: Far station [m], shape (3,).
        motion: Filled per strain with the rotation w beyond the link (3), the velocity v of dx = w x x + v
            (3), the rotation of R_mid (3) and the motion of the far station (3), shape (6, 12).
    """
    whole, half = np.empty((1, 3)), np.empty((1, 3))
    jacobian, half_jacobian = np.empty((1, 3, 3)), np.empty((1, 3, 3))
    lever = np.empty(3)
    for k in range(3):
        whole[0, k] = strain[k]
        half[0, k] = 0.5 * strain[k]
    jacobian_kernel(whole, jacobian)
    jacobian_kernel(half, half_jacobian)
    for c in range(3):
        rotate(rotation, jacobian[0, :, c], motion[c, 0:3])
        cross(motion[c, 0:3], far, lever)
        rotate(rotation, half_jacobian[0, :, c], motion[c, 6:9])
        for k in range(3):
            # R_mid has half of the link's rotation.
            motion[c, 6 + k] *= 0.5
        cross(motion[c, 6:9], chord, motion[c, 9:12])
        for k in range(3):
            motion[c, 3 + k] = motion[c, 9 + k] - lever[k]
            motion[3 + c, k] = motion[3 + c, 6 + k] = 0.0
            motion[3 + c, 3 + k] = motion[3 + c, 9 + k] = middle[k, c]


@njit(cache=True, nogil=True)
def point_motion(strain: Floats, rotation: Floats, share: float, arm: Floats, motion: Floats) -> None:
    """Fill the motion of a point at a share of a link for each of its strains, shape (6, 3).

    Args:
        strain: theta and t, shape (6,).
        rotation: R of the near station, shape (3, 3).
        share: Share s of the link.
        arm: Point less near station [m], shape (3,).
        motion: Filled, shape (6, 3).
    """
    part, chord_rotation, jacobian = np.empty((1, 3)), np.empty((1, 3, 3)), np.empty((1, 3, 3))
    spin = np.empty(3)
    for k in range(3):
        part[0, k] = 0.5 * share * strain[k]
    exp_kernel(part, chord_rotation)
    jacobian_kernel(part, jacobian)
    for c in range(3):
        rotate(rotation, jacobian[0, :, c], spin)
        cross(spin, arm, motion[c])
        rotate(rotation, chord_rotation[0, :, c], motion[3 + c])
        for k in range(3):
            # Up to its share s the link rotates by s theta, its chord by half of that.
            motion[c, k] *= 0.5 * share
            motion[3 + c, k] *= share


@njit(cache=True, nogil=True)
def inner_moments(
    strain: Floats,
    rotations: Floats,
    positions: Floats,
    actions: Actions,
    points: Floats,
    force: Floats,
    moments: Floats,
) -> None:
    """Fill the change of moment by the actions inside each link for each of its strains, (links, 6, 3)."""
    arm, change, motion = np.empty(3), np.empty(3), np.empty((6, 3))
    moments.fill(0.0)
    for a in range(len(actions.link)):
        if actions.share[a] >= 1.0:
            continue
        i = actions.link[a]
        for k in range(3):
            arm[k] = points[a, k] - positions[i, k]
        point_motion(strain[i], rotations[i], actions.share[a], arm, motion)
        for c in range(6):
            cross(motion[c], force[a], change)
            for k in range(3):
                moments[i, c, k] += change[k]


@njit(cache=True, nogil=True)
def rigid_moment(motion: Floats, beyond: Floats, moment: Floats) -> None:
    """Fill the change of the moment about the origin when all beyond moves: sum (w x x + v) x F.

    Args:
        motion: w (3), then v (3), shape (6,).
        beyond: Sums over the actions beyond, as of ``wrenches``, shape (15,).
        moment: Filled, shape (3,).
    """
    cross(motion[3:6], beyond[0:3], moment)
    # (w x x) x F = (x F^T) w - (x . F) w.
    trace = beyond[6] + beyond[10] + beyond[14]
    for k in range(3):
        moment[k] -= trace * motion[k]
        for m in range(3):
            moment[k] += beyond[6 + 3 * k + m] * motion[m]


@njit(cache=True, nogil=True)
def wrench_jacobian(
    positions: Floats,
    middles: Floats,
    beyond: Floats,
    motions: Floats,
    inner: Floats,
    parts: Floats,
    jacobian: Floats,
) -> None:
    """Fill the derivative of all wrenches by all strains.

    A strain of link j moves all beyond it as a rigid body. Nearer links feel the change of the moment of the
    moved actions, the same for all; farther ones rotate with their actions; the link itself does both in
    part.

    Args:
        positions: Stations [m], shape (links + 1, 3).
        middles: R_mid, shape (links, 3, 3).
        beyond: Sums over the actions beyond each link, shape (links, 15).
        motions: Motion by each strain, as of ``link_motion``, shape (links, 6, 12).
        inner: Change of moment by actions inside each link, shape (links, 6, 3).
        parts: Change of wrench by rotating those actions, as of ``rotated_parts``, shape (links, 6, 3).
        jacobian: Filled, shape (6 links, 6 links).
    """
    links = len(middles)
    change = np.empty(3)
    rotated = np.empty((links, 6, 3))
    jacobian.fill(0.0)
    # No other link rotates link 0.
    for i in range(1, links):
        _rotated_whole(positions, middles, beyond, i, rotated[i])
        for r in range(6):
            for k in range(3):
                rotated[i, r, k] += parts[i, r, k]
    for j in range(links):
        for c in range(6):
            column = 6 * j + c
            rigid_moment(motions[j, c], beyond[j], change)
            _same_link(positions, middles, beyond, motions[j, c], change, j, column, jacobian)
            _add_rotation(parts[j], motions[j, c, 6:9], j, column, jacobian)
            for i in range(j + 1, links):
                _add_rotation(rotated[i], motions[j, c, 0:3], i, column, jacobian)
            for k in range(3):
                change[k] += inner[j, c, k]
            for i in range(j):
                rotate_back(middles[i], change, jacobian[6 * i + 3 : 6 * i + 6, column])


@njit(cache=True, nogil=True)
def _moment_about_middle(positions: Floats, beyond: Floats, i: int, arm: Floats, moment: Floats) -> None:
    """Fill the middle of a link's chord and the moment about it of all beyond."""
    for k in range(3):
        arm[k] = 0.5 * (positions[i, k] + positions[i + 1, k])
    cross(arm, beyond[i, 0:3], moment)
    for k in range(3):
        moment[k] = beyond[i, 3 + k] - moment[k]


@njit(cache=True, nogil=True)
def _same_link(
    positions: Floats,
    middles: Floats,
    beyond: Floats,
    motion: Floats,
    change: Floats,
    j: int,
    column: int,
    jacobian: Floats,
) -> None:
    """Fill the derivative of a link's wrench by its own strain: R_mid rotates, all beyond moves."""
    arm, moment, local, rotated = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    total, spin = beyond[j, 0:3], motion[6:9]
    cross(total, spin, rotated)
    rotate_back(middles[j], rotated, jacobian[6 * j : 6 * j + 3, column])
    _moment_about_middle(positions, beyond, j, arm, moment)
    cross(moment, spin, rotated)
    cross(total, motion[9:12], local)
    for k in range(3):
        rotated[k] += change[k] + 0.5 * local[k]
    rotate_back(middles[j], rotated, jacobian[6 * j + 3 : 6 * j + 6, column])


@njit(cache=True, nogil=True)
def _add_rotation(rotated: Floats, spin: Floats, i: int, column: int, jacobian: Floats) -> None:
    """Add the change of link i's wrench by a rotation, shape (3,), to a column of the jacobian."""
    for r in range(6):
        change = rotated[r, 0] * spin[0] + rotated[r, 1] * spin[1] + rotated[r, 2] * spin[2]
        jacobian[6 * i + r, column] += change


@njit(cache=True, nogil=True)
def _rotated_whole(positions: Floats, middles: Floats, beyond: Floats, i: int, rotated: Floats) -> None:
    """Fill the change of a link's wrench per rotation w of it and all beyond: sum (w x r) x F - w x M."""
    arm, moment, spin, change = np.empty(3), np.empty(3), np.zeros(3), np.empty(3)
    total = beyond[i, 0:3]
    _moment_about_middle(positions, beyond, i, arm, moment)
    trace = 0.0
    for k in range(3):
        trace += beyond[i, 6 + 4 * k] - arm[k] * total[k]
    for axis in range(3):
        spin[axis] = 1.0
        cross(total, spin, change)
        rotate_back(middles[i], change, rotated[0:3, axis])
        cross(moment, spin, change)
        change[axis] -= trace
        for k in range(3):
            change[k] += beyond[i, 6 + 3 * k + axis] - arm[k] * total[axis]
        rotate_back(middles[i], change, rotated[3:6, axis])
        spin[axis] = 0.0


@njit(cache=True, nogil=True)
def rotated_parts(middles: Floats, actions: Actions, drive: ChainInputs, parts: Floats) -> None:
    """Fill the change, per unit rotation, of the wrench by actions inside each link, shape (links, 6, 3)."""
    force, couple, column, spin = np.empty(3), np.empty(3), np.empty(6), np.zeros(3)
    parts.fill(0.0)
    for a in range(len(actions.link)):
        i = actions.link[a]
        if actions.share[a] >= 1.0:
            continue
        for axis in range(3):
            spin[axis] = 1.0
            cross(drive.force[a], spin, force)
            cross(drive.couple[a], spin, couple)
            spin[axis] = 0.0
            column.fill(0.0)
            add_part(actions.beta[a], middles[i], force, couple, column)
            for k in range(6):
                parts[i, k, axis] += column[k]


@njit(cache=True, nogil=True)
def unit_wrenches(
    positions: Floats,
    middles: Floats,
    actions: Actions,
    action: int,
    points: Floats,
    unit: Floats,
    wrench: Floats,
) -> None:
    """Add a force and couple, shape (6,), at an action's place to all links' wrenches, shape (links, 6)."""
    arm, moment = np.empty(3), np.empty(3)
    last = actions.link[action]
    if actions.share[action] < 1.0:
        add_part(actions.beta[action], middles[last], unit[:3], unit[3:], wrench[last])
        last -= 1
    for i in range(last + 1):
        for k in range(3):
            arm[k] = points[action, k] - 0.5 * (positions[i, k] + positions[i + 1, k])
        cross(arm, unit[:3], moment)
        for k in range(3):
            moment[k] += unit[3 + k]
        add_rotated_back(middles[i], unit[:3], wrench[i, 0:3])
        add_rotated_back(middles[i], moment, wrench[i, 3:6])
