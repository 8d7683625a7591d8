"""What each link of the finite-element model feels and does: its wrench, its strain, their derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats
from softarm.estimator.model import Load
from softarm.estimator.rod.arrays import Actions, ChainInputs
from softarm.estimator.rod.chain import Chain
from softarm.estimator.rod.samples import Samples
from softarm.estimator.rod.statics import action_points, strain_between, wrenches
from softarm.estimator.rotations import exp

MOVE = 1e-5
"""Largest rotation [rad] or translation [m] by which frames are moved to differentiate."""


@dataclass(frozen=True)
class LocalStates:
    """Strains and wrenches of all links.

    Args:
        strains: Shape (samples, links, 6).
        wrenches: Shape (samples, links, 6).
        strain_slopes: Derivative by the inputs (pressures, then loads), shape (samples, links, 6, inputs).
        wrench_slopes: Shape (samples, links, 6, inputs).
    """

    strains: Floats
    wrenches: Floats
    strain_slopes: Floats
    wrench_slopes: Floats


@njit(cache=True, nogil=True)
def local_kernel(
    length: Floats,
    actions: Actions,
    pressures: Floats,
    force: Floats,
    couple: Floats,
    rotations: Floats,
    positions: Floats,
    strains: Floats,
    wrench: Floats,
) -> None:
    """Fill strains and wrenches, shape (samples, links, 6), of stations, the clamp first.

    Args:
        length: Rest lengths [m], shape (links,).
        actions: Where loads act.
        pressures: Any pressures; they do not matter here, shape (chambers,).
        force: Forces of the actions [N], shape (samples, actions, 3).
        couple: Their couples [N m], shape (samples, actions, 3).
        rotations: Shape (samples, links + 1, 3, 3).
        positions: Shape (samples, links + 1, 3).
        strains: Filled.
        wrench: Filled.
    """
    middles = np.empty((len(length), 3, 3))
    points, beyond = np.empty((len(actions.link), 3)), np.empty((len(length), 15))
    for s in range(len(rotations)):
        strain_between(rotations[s], positions[s], length, strains[s], middles)
        action_points(strains[s], length, rotations[s], positions[s], actions, points)
        drive = ChainInputs(pressures, force[s], couple[s], strains[s])
        wrenches(positions[s], middles, actions, points, drive, wrench[s], beyond)


def local_states(chain: Chain, loads: Sequence[Load], samples: Samples) -> LocalStates:
    """Split the samples link by link, differentiating by central differences along the twists."""
    strains, wrench = _evaluate(chain, loads, samples, samples.loads, samples.positions, samples.rotations)
    inputs = samples.twists.shape[-1]
    strain_slopes = np.empty((*strains.shape, inputs))
    wrench_slopes = np.empty((*strains.shape, inputs))
    for column in range(inputs):
        twists = samples.twists[..., column]
        # Pascals and newtons alike move the frames by the same small amount.
        size = MOVE / np.maximum(np.abs(twists).max(axis=(1, 2)), 1e-12)
        ends = []
        for sign in (1.0, -1.0):
            amplitudes = samples.loads.copy()
            if column >= chain.chamber_count:
                amplitudes[:, column - chain.chamber_count] += sign * size
            move = (sign * size)[:, None, None] * twists
            positions = samples.positions + move[..., :3]
            rotations = exp(move[..., 3:]) @ samples.rotations
            ends.append(_evaluate(chain, loads, samples, amplitudes, positions, rotations))
        for slopes, ahead, behind in zip((strain_slopes, wrench_slopes), *ends, strict=True):
            slopes[..., column] = (ahead - behind) / (2.0 * size[:, None, None])
    return LocalStates(strains, wrench, strain_slopes, wrench_slopes)


def _evaluate(
    chain: Chain,
    loads: Sequence[Load],
    samples: Samples,
    amplitudes: Floats,
    positions: Floats,
    rotations: Floats,
) -> tuple[Floats, Floats]:
    count, links = len(samples), chain.links
    force, couple = np.zeros((count, links + len(loads), 3)), np.zeros((count, links + len(loads), 3))
    force[:, :links] = chain.mass[:, None] * samples.gravity[:, None, :]
    for k, load in enumerate(loads):
        target = force if load.kind == "force" else couple
        target[:, links + k] = amplitudes[:, k, None] * np.array(load.direction)
    clamp = np.tile([0.0, 0.0, chain.heights[0]], (count, 1, 1))
    strains, wrench = np.empty((count, links, 6)), np.empty((count, links, 6))
    local_kernel(
        chain.lengths,
        chain.actions(loads),
        np.zeros(chain.chamber_count),
        force,
        couple,
        np.concatenate([np.broadcast_to(np.eye(3), (count, 1, 3, 3)), rotations], axis=1),
        np.concatenate([clamp, positions], axis=1),
        strains,
        wrench,
    )
    return strains, wrench
