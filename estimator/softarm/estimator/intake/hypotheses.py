"""The choice among explanations of a recording: one that wins by stated odds, or none."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

What = TypeVar("What")

UNAMBIGUOUS = 100.0
"""Odds of an explanation against the next from which a run is corrected ("decisive": Jeffreys, Theory of
Probability, 1961, appendix B)."""


@dataclass(frozen=True)
class Explanation(Generic[What]):
    """One explanation with its likelihood.

    Args:
        what: The explanation.
        log_likelihood: Of the data under it, prior included, up to a constant.
    """

    what: What
    log_likelihood: float


@dataclass(frozen=True)
class BestExplanation(Generic[What]):
    """The best explanation and the next.

    Args:
        second: The next; the best itself where there is no other.
        odds: Of the best against the next; infinite where there is no other.
    """

    best: Explanation[What]
    second: Explanation[What]
    odds: float

    @property
    def unambiguous(self) -> bool:
        """Whether the best wins by ``UNAMBIGUOUS``."""
        return self.odds >= UNAMBIGUOUS


def choose(explanations: Sequence[Explanation[What]]) -> BestExplanation[What]:
    """Order explanations by likelihood; of equal ones the first given is the best."""
    order = sorted(explanations, key=lambda one: -one.log_likelihood)
    if len(order) < 2:
        return BestExplanation(order[0], order[0], np.inf)
    gap = order[0].log_likelihood - order[1].log_likelihood
    return BestExplanation(order[0], order[1], float(np.exp(min(gap, 500.0))))
