"""How often recordings show an effect.

A wall or a ceiling acts only where the arm goes far. What the model gets wrong of one pose it gets wrong all
the while that the arm stays there: the samples of one excursion are a single independent look at an effect,
and a law that acts in no other may stand for that error. Two excursions err alike only by chance, and so do
poses that an arm takes one after the other while an effect acts all along: a long excursion is as many looks
as its motion has independent samples.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.statistics import correlation_length

BRINK = 0.01
"""Share of the largest weighted square of a change from which an effect acts."""
PAUSE_S = 1.0
"""Time without an effect that ends an excursion [s]: longer than arms of this size swing."""
ONCE = 1.5
"""Number of looks, between one and two, below which an effect was seen once."""


@dataclass(frozen=True)
class Excursions:
    """Where an effect acts in some recordings.

    Args:
        number: Effective number of looks: (sum q)^2 / sum q^2, q the weighted squares of the change in each.
        samples: Mean number of samples in one, weighted alike.
    """

    number: float
    samples: float

    @property
    def once(self) -> bool:
        """Whether the effect was seen once."""
        return self.number < ONCE


def excursions_of(recordings: Iterable[tuple[Floats, Floats, float]]) -> Excursions:
    """Find the excursions in which an effect acts.

    Args:
        recordings: Of each, the time of its samples [s] and the weighted squares of the effect's change, both
            of shape (samples,); and the samples in which the arm stays near one pose.
    """
    listed = list(recordings)
    largest = max((float(squares.max(initial=0.0)) for _, squares, _ in listed), default=0.0)
    found: list[Floats] = []
    for time, squares, stays in listed:
        acting = np.flatnonzero(squares > BRINK * largest)
        if len(acting):
            ends = np.flatnonzero(np.diff(time[acting]) > PAUSE_S) + 1
            for excursion in np.split(acting, ends):
                looks = max(int(len(excursion) / stays), 1)
                found += [squares[own] for own in np.array_split(excursion, looks)]
    shares = np.array([squares.sum() for squares in found])
    if not shares.sum() > 0.0:
        return Excursions(0.0, 0.0)
    sizes = np.array([len(squares) for squares in found])
    return Excursions(
        float(shares.sum() ** 2 / (shares**2).sum()), float((shares * sizes).sum() / shares.sum())
    )


def samples_near_one_pose(readings: Floats) -> float:
    """Return how long an arm stays near one pose, in samples: the longest correlation of any reading.

    Args:
        readings: NaN where lost, shape (samples, rows).
    """
    read = readings[:, np.isfinite(readings).any(axis=0)]
    moved = read - np.nanmean(read, axis=0)
    return max((correlation_length(column) for column in moved.T), default=1.0)
