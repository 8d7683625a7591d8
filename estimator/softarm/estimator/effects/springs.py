"""Springs that act on one side: how walls press on the arm and cords pull at it.

A spring that is extended by e > 0 has the force f = k e; its wrenches on the sections are -f de/du, with u
the sections' twists. Walls may be a hundred times as stiff as the arm, and where one point presses, another
loses touch. So all forces of a sample are found together, with the arm's compliance C and A = de/du:

    f = k max(e0 - A C A' f, 0),    e0 the extensions without these forces,

a linear complementarity problem with one solution, since A C A' + 1/k is positive definite. Springs that are
wrongly taut or slack are exchanged until none is (block principal pivoting: Judice and Pires, Comput. Oper.
Res. 21 (1994) 587).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats

TRIES = 3
"""Exchanges of all springs that are wrongly taut or slack before they are exchanged one at a time."""
MOST_EXCHANGES = 60
"""Exchanges after which a search ends anyhow: where the arm is unstable, there may be no solution."""
SOFTEST = 1e-9
"""Least stiffness [N/m]: a spring that has none has no force."""
SLACK = 1e-12
"""Extension [m] up to which a spring is slack, for it is a difference of larger numbers."""


@dataclass(frozen=True)
class Springs:
    """Springs at the poses of some samples.

    Args:
        stiffness: Of each spring [N/m], shape (springs,).
        extensions: By how much each is extended; it is slack where that is negative [m], shape (samples,
            springs).
        gradients: Derivatives of the extensions by the sections' twists, shape (samples, springs, sections,
            6).
    """

    stiffness: Floats
    extensions: Floats
    gradients: Floats

    @property
    def forces(self) -> Floats:
        """Forces in these poses [N], shape (samples, springs)."""
        return np.asarray(self.stiffness * np.maximum(self.extensions, 0.0))

    def wrenches(self, forces: Floats) -> Floats:
        """Return the wrenches of forces on the sections, shape (samples, sections, 6)."""
        return np.asarray(-np.einsum("tp,tpsk->tsk", forces, self.gradients))

    def balanced(self, forces: Floats, compliance: Floats) -> Floats:
        """Return the forces that balance where the arm gives way to them.

        Args:
            forces: Those in whose pose the extensions are [N], shape (samples, springs).
            compliance: Section twists per unit of each wrench, shape (samples, 6 sections, 6 sections).
        """
        samples, springs = forces.shape
        rows = self.gradients.reshape(samples, springs, -1)
        yielding = rows @ compliance @ np.swapaxes(rows, 1, 2)
        free = self.extensions + np.einsum("tpq,tq->tp", yielding, forces)
        balanced = forces.copy()
        _balance(yielding + np.diag(1.0 / np.maximum(self.stiffness, SOFTEST)), free, balanced)
        return balanced


def together(springs: Sequence[Springs]) -> Springs:
    """Put the springs of several effects side by side."""
    return Springs(
        np.concatenate([one.stiffness for one in springs]),
        np.concatenate([one.extensions for one in springs], axis=1),
        np.concatenate([one.gradients for one in springs], axis=1),
    )


@njit(cache=True, nogil=True)
def _balance(matrix: Floats, free: Floats, forces: Floats) -> None:
    """Solve for the forces of each sample in place.

    Args:
        matrix: A C A' + 1/k, shape (samples, springs, springs).
        free: Extensions without forces [m], shape (samples, springs).
        forces: Where the search begins [N], shape (samples, springs).
    """
    samples, springs = free.shape
    taut, extension = np.zeros(springs, dtype=np.bool_), np.zeros(springs)
    for t in range(samples):
        if not (free[t] > 0.0).any():
            forces[t] = 0.0
            continue
        for p in range(springs):
            taut[p] = forces[t, p] > 0.0
        fewest, tries = springs + 1, TRIES
        for _ in range(MOST_EXCHANGES):
            members = np.flatnonzero(taut)
            forces[t] = 0.0
            if len(members):
                forces[t][members] = np.linalg.solve(matrix[t][members][:, members], free[t][members])
            extension[:] = free[t] - matrix[t] @ forces[t]
            wrong = np.where(taut, forces[t] < 0.0, extension > SLACK)
            count = int(wrong.sum())
            if count == 0:
                break
            if count < fewest:
                fewest, tries = count, TRIES
            else:
                tries -= 1
            if tries >= 0:
                taut ^= wrong
            else:  # one at a time, which always ends
                last = np.flatnonzero(wrong)[-1]
                taut[last] = not taut[last]
        forces[t] = np.maximum(forces[t], 0.0)
