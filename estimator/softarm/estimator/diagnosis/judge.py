"""What speaks for a candidate: whether the size that some recordings show predicts the others."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.folds import NewFolds
from softarm.estimator.diagnosis.gaussian import Gaussian
from softarm.estimator.diagnosis.marginal import cost_of

CERTAIN = 40.0
"""Gain in the criterion that decides even where the gain on single folds scatters."""
ANY_SIZE = 100.0
"""Variance of a candidate's size, in units of its fit, that leaves it to the data."""
MATERIAL = 0.10
"""Share of the explainable mismatch that an effect must remove."""
EXPLAINABLE = 0.25
"""Share of what scatters, or of the noise if that is less, that counts as explainable at least."""
REPEATABLE = 1.0
"""Or root mean square of its change over the scatter of the residuals."""
FALSE_ALARM = 0.01
"""Chance of as much in the whole search where nothing is missing, above which nothing is accepted: one false
alarm in a hundred unchanged arms is what is aimed at."""


@dataclass(frozen=True)
class Judgement:
    """What speaks for a candidate, on stretches that its fit has not seen.

    Args:
        before: Root mean square of the residuals over their scale without it.
        after: With it.
        gain_ci95: Bootstrap interval of 1 - after / before.
        share: Share of the explainable mismatch that it removes.
        change: Root mean square of its change over the scatter.
        search_p: Chance of as much in the whole search where nothing is missing.
        delta_bic: Of the candidate.
        certain: Gain in the criterion that decides even where the gain on single folds scatters.
        least: Gain in the criterion that is needed of an effect that was seen once.
    """

    before: float
    after: float
    gain_ci95: tuple[float, float]
    share: float
    change: float
    search_p: float
    delta_bic: float
    certain: float = CERTAIN
    least: float = 0.0

    @property
    def accepted(self) -> bool:
        """Whether all of it holds."""
        return self.holds and self.delta_bic >= self.least

    @property
    def seen_once(self) -> bool:
        """Whether all of it would hold, had the effect been seen in more than one pose."""
        return self.holds and not self.accepted

    @property
    def holds(self) -> bool:
        """Whether all of it holds but for the number of poses.

        A wall that is reached in one fold leaves resamplings of the others as they were: a gain of 0.
        """
        certain = self.delta_bic >= self.certain and self.after < self.before
        return (
            (self.gain_ci95[0] >= 0.0 or certain)
            and (self.share >= MATERIAL or self.change >= REPEATABLE)
            and self.search_p <= FALSE_ALARM
        )


@dataclass(frozen=True)
class FoldCosts:
    """How well folds are predicted without a candidate, and with the size of it that the other folds show.

    Args:
        before: Cost of each fold without it, shape (folds,).
        after: With it.
        counts: Effective number of samples of each.
        changed: Weighted squares of the candidate's change in each, over effective samples.
        gains: By how much the candidate lowers the cost of each.
        usual: By how much what nominal recordings have of it already lowers that, shape (folds,). Candidates
            are compared by both: what every arm may have of one may explain more than a change of another.
        frequency_gain: By how much it lowers the cost of the natural frequency, which belongs to no fold.
        changed_gain: By how much the candidate lowers the cost of all folds beside its usual share.
    """

    before: Floats
    after: Floats
    counts: Floats
    changed: Floats
    gains: Floats
    usual: Floats
    frequency_gain: float = 0.0
    changed_gain: float = 0.0

    @property
    def gain(self) -> float:
        """By how much the candidate lowers the cost."""
        return float(self.gains.sum()) + self.frequency_gain


def fold_costs(shown: NewFolds, prior: Gaussian, changed: Floats) -> FoldCosts:
    """Predict each recording, or stretch, with the size of a candidate that the others show, and without.

    What is common to all recordings has the prior from before any of those in question: a calibration
    that has followed the change would hide it.

    Args:
        shown: Normal equations of new columns by fold, the candidate's change the last.
        prior: Of the others.
        changed: Weighted squares of the candidate's change in each fold, over effective samples.
    """
    extended, size = prior.augment(0.0, ANY_SIZE), len(prior.mean)
    rows = []
    for own, others in shown.folds:
        learnt = extended.posterior(others, 1.0)
        known = prior.augment(float(learnt.mean[-1]), float(learnt.covariance[-1, -1]))
        before = cost_of(prior, own.selected(range(size)), 1.0)
        rows.append((before, cost_of(known, own, 1.0), own.count))
    without, after, counts = np.array(rows, dtype=np.float64).T
    return FoldCosts(without, after, counts, changed, without - after, np.zeros_like(without))


def judge(costs: FoldCosts, rng: np.random.Generator, search_p: float, delta_bic: float) -> Judgement:
    """Judge a candidate by what it predicts where it was not fitted.

    Args:
        costs: How well the searched folds are predicted without and with it.
        rng: Of the bootstrap.
        search_p: Chance of as much in the whole search where nothing is missing.
        delta_bic: Of the candidate.
    """
    before, after, count = costs.before.sum(), costs.after.sum(), costs.counts.sum()
    explainable = max(float(before - count), least_explainable(float(before), float(count)))
    return Judgement(
        float(np.sqrt(before / count)),
        float(np.sqrt(after / count)),
        bootstrap(rng, costs.before, costs.after),
        float(before - after) / explainable,
        float(np.sqrt(costs.changed.sum() / count)),
        search_p,
        delta_bic,
    )


def least_explainable(cost: float, count: float) -> float:
    """Return what counts as explainable of residuals that are no larger than their noise.

    What all recordings have in common has taken its part of them, so they may be much smaller.

    Args:
        cost: Weighted squares that are left of them.
        count: Effective number of samples.
    """
    return EXPLAINABLE * min(cost, count)


def bootstrap(
    rng: np.random.Generator, before: Floats, after: Floats, draws: int = 500
) -> tuple[float, float]:
    """Return the interval of 1 - sqrt(after / before) over resampled stretches."""
    chosen = rng.integers(0, len(before), (draws, len(before)))
    ratio = after[chosen].sum(axis=1) / np.maximum(before[chosen].sum(axis=1), 1e-12)
    gains = 1.0 - np.sqrt(np.maximum(ratio, 0.0))
    low, high = np.percentile(gains, [2.5, 97.5])
    return float(low), float(high)
