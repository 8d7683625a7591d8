"""What the readings determine, and what only the prior or nothing at all does."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.counted import counted
from softarm.estimator.inverse.unknowns import Unknowns

UNSEEN = 1e-6
"""Singular value, relative to the largest, under which a direction counts as unobservable."""
LARGE_SHARE = 0.3
"""Component of a unit direction from which an input is named in words."""


@dataclass(frozen=True)
class Observability:
    """How well the data determine the free inputs.

    Args:
        unknowns: Names and scales of the inputs.
        free: Which inputs are not held, shape (inputs,).
        rank: Number of directions of the free inputs that the data determine.
        data_rows: Number of independent numbers the data offer: rows of sensors and measured pressures.
        singular_values: Of the whitened Jacobian by the scaled free inputs: scale of the input over the
            standard deviation with which the data alone determine it, in each direction, descending.
        directions: The directions, columns in the space of scaled inputs, shape (inputs, free inputs).
    """

    unknowns: Unknowns
    free: Flags
    rank: int
    data_rows: int
    singular_values: Floats
    directions: Floats

    @property
    def unobservable_directions(self) -> tuple[str, ...]:
        """Combinations of inputs that the data do not see at all, in words."""
        count = int(self.free.sum())
        return tuple(
            describe_direction(self.unknowns, self.directions[:, k]) for k in range(self.rank, count)
        )

    @property
    def weak_directions(self) -> tuple[str, ...]:
        """Combinations that the data see less sharply than the inputs' typical size, in words."""
        weak = np.flatnonzero(self.singular_values[: self.rank] < 1.0)
        return tuple(describe_direction(self.unknowns, self.directions[:, k]) for k in weak)

    @property
    def statement(self) -> str:
        """What is estimated from what, and what is not, in one or two sentences."""
        free = int(self.free.sum())
        names = [name for name, one in zip(self.unknowns.names, self.free, strict=True) if one]
        counts = f"{counted(self.data_rows, 'independent reading')}, {counted(free, 'unknown')}"
        head = f"{counts} ({', '.join(names)}): "
        if self.rank < free:
            unseen = "; ".join(self.unobservable_directions)
            return f"{head}{free - self.rank} of their combinations cannot be observed: {unseen}."
        weak = self.weak_directions
        if weak:
            return f"{head}all are determined, but only weakly {'; '.join(weak)}."
        return f"{head}all are determined."


def analyse(unknowns: Unknowns, free: Flags, jacobian: Floats, information: Floats) -> Observability:
    """Analyse the data at an estimate.

    Args:
        unknowns: Names and scales of the inputs.
        free: Which inputs are not held, shape (inputs,).
        jacobian: Derivative of the data by the inputs, shape (rows, inputs).
        information: Inverse covariance of the data's noise, shape (rows, rows).
    """
    members = np.flatnonzero(free)
    whitened = np.linalg.cholesky(information).T @ jacobian
    scaled = whitened[:, members] * unknowns.scale[members]
    values = np.zeros(len(members))
    directions = np.zeros((unknowns.size, len(members)))
    rank = rows = 0
    if scaled.size:
        _, singular, basis = np.linalg.svd(scaled, full_matrices=True)
        values[: len(singular)] = singular
        directions[members] = basis.T
        # Where even the best direction is poorly observable, the inputs' typical size is the reference.
        rank = int((singular > UNSEEN * max(singular[0], 1.0)).sum())
        rows = len(scaled)
    return Observability(unknowns, free, rank, rows, values, directions)


def describe_direction(unknowns: Unknowns, direction: Floats) -> str:
    """Name the inputs that make up a direction, such as ``tip_x with -0.45 N per N of intermediate_x``."""
    order = np.argsort(-np.abs(direction))
    large = [int(k) for k in order if abs(direction[k]) >= LARGE_SHARE * abs(direction[order[0]])]
    lead, others = large[0], large[1:]
    if not others:
        return unknowns.names[lead]
    physical = direction * unknowns.scale
    parts = [
        f"{physical[k] / physical[lead]:+.2g} {unknowns.units[k]} of {unknowns.names[k]}" for k in others
    ]
    return f"1 {unknowns.units[lead]} of {unknowns.names[lead]} with {join(parts)}"


def join(words: Sequence[str]) -> str:
    """Join words as in a sentence."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"
