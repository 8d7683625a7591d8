"""Which accepted effects hold on data that confirm a choice: left out of every fit, and not reported."""

from collections.abc import Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.candidates import Accepted, ChosenEffects
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.fit import Fit, change_by
from softarm.estimator.diagnosis.marginal import Marginaliser
from softarm.estimator.diagnosis.normal_equations import NewColumns, NormalEquations, added, total
from softarm.estimator.diagnosis.stage import Stage

MOST_UNPROVEN = 3
"""Effects that may fail on held-out data before the search ends."""
FRAGMENT = 0.3
"""Share of the largest gain of an earlier choice that a later one must reach: less is a fragment of it."""
DRAWS = 40
SURE = 10.0
"""Resamplings of held-out stretches, and the percentile of the gain over them that must not be negative."""
NOTHING = 1.0
"""Gain in cost that one independent residual makes by chance; stretches without excitation give none."""
SHOWN = (2.0 + (4.0 + NOTHING) ** 0.5) ** 2
"""Gain expected of an effect that acts, from which stretches can disprove it: g with g - 4 sqrt(g) = NOTHING.
The gain of an effect of the right size is normal with mean g and standard deviation 2 sqrt(g)."""
BY_CHANCE = 2.0
"""Standard deviations by which the gain of an effect that acts may fall short of its mean."""


def proven(search: Search) -> tuple[ChosenEffects, list[Accepted]]:
    """Search until all that is accepted holds on data that confirm it, which are reported nowhere.

    The more effects have failed there, the surer the next must be; and one that explains little of what these
    did is a fragment of something else. What holds after a choice has failed as a whole has to explain more
    than that did, searched and confirming data together: what resembles the mismatch less changes less of the
    confirming data, which then cannot disprove it.

    Returns:
        The choice, and the effects that were accepted on the way and did not hold.
    """
    dropped: list[Accepted] = []
    most = failed = 0.0
    while True:
        choice = search.run(frozenset(one.candidate.number for one in dropped))
        gain = choice.fit.gain if choice.fit is not None else 0.0
        most = max(most, gain)
        lost = unproven(search, choice, SURE / (1 + len(dropped)))
        every = list(range(len(choice.accepted)))
        if lost == every:
            failed = max(failed, gain_of_all(search, choice))
        elif gain < FRAGMENT * most or (
            failed and gain_of_all(search, search.without(choice, lost)) < failed
        ):
            lost = every
        dropped += [choice.accepted[k] for k in lost]
        if not lost or len(dropped) > MOST_UNPROVEN:
            return search.without(choice, lost) if lost else choice, dropped


def gain_of_all(search: Search, choice: ChosenEffects) -> float:
    """Return what effects gain in searched and confirming data, less the price of their parameters."""
    fit = choice.fit
    if fit is None:
        return 0.0
    before, after = _confirming(search.left(None).parts), _confirming(search.left(fit).parts)
    confirmed = _gain(search, before, after, range(len(after))) if after else 0.0
    return search.worth(fit) + confirmed


def unproven(search: Search, choice: ChosenEffects, sure: float = SURE) -> list[int]:
    """List accepted effects without which confirming data are predicted as well.

    Where these are predicted as well without any of several effects, it is the weakest: the others are judged
    once they are chosen and fitted without it, for its size took from theirs.

    Judged like folds in ``Search.judge``: the prior of the calibration is that from before these recordings.
    What would hardly show in these data, as a wall that is not reached there, is not judged by them; nor is
    it by the stretches of a resampling in which an effect that acts may by chance gain less than nothing. An
    effect with which all of them together are predicted as much better as its size says, but for chance, is
    confirmed, even if that rests on few: a mass shows where the mount is turned.

    Args:
        search: The search.
        choice: What it accepted.
        sure: Percentile of the gain over resampled stretches that must not be negative.
    """
    fit = choice.fit
    if fit is None:
        return []
    after = _confirming(search.left(fit).parts)
    if not after:
        return []
    together = _marginaliser(search, after)

    def disproved(others: Fit | None) -> bool:
        before, changes = _confirming(search.left(others).parts), confirming_changes(search, fit, others)
        gain = together.renewed(before).cost - together.cost
        # Less than the sum over the stretches: the common coefficients learn from all of them.
        expected = expected_gain(together, added(changes))
        if expected < SHOWN or gain > expected - by_chance(expected):
            return False
        alone = [_marginaliser(search, [part]) for part in after]
        each = np.array([expected_gain(seen, new) for seen, new in zip(alone, changes, strict=True)])
        drawn = [
            _gain(search, before, after, chosen) + lost_by_chance(each, chosen)
            for chosen in _draws(search.rng, len(after))
        ]
        return gain < NOTHING or float(np.percentile(drawn, sure)) < -NOTHING

    every = list(range(len(choice.accepted)))
    if len(every) > 1 and disproved(None):
        return [min(every, key=lambda k: search.contribution(fit, k))]
    rests = [search.subset(fit, [j for j in every if j != k]) for k in every]
    return [k for k in every if disproved(rests[k])]


def confirming_changes(search: Search, fit: Fit, rest: Fit | None) -> list[NewColumns]:
    """Return the products of what effects change in each confirming stretch.

    Args:
        search: The search.
        fit: All effects.
        rest: Those that are taken for granted.
    """

    def change(stage: Stage) -> Floats:
        more: Floats = change_by(stage, fit) - change_by(stage, rest)
        return more[..., None]

    parts = _confirming(search.left(fit).parts)
    return search.evidence.with_columns(search.weights, change, parts, search.left(fit).residuals)


def expected_gain(seen: Marginaliser, change: NewColumns) -> float:
    """Return by how much effects lower the cost of some stretches if they act just as in a fit."""
    return float(seen.marginal(change).matrix[0, 0])


def by_chance(expected: float) -> float:
    """Return by how much the gain of effects that act may by chance fall short of what is expected."""
    return BY_CHANCE * 2.0 * float(np.sqrt(expected))


def lost_by_chance(expected: Floats, chosen: Sequence[int]) -> float:
    """Return by how much stretches may by chance be predicted worse with an effect that acts.

    Where g is expected of a stretch, m times the same gain m g on average, with deviation 2 m sqrt(g).

    Args:
        expected: Gain expected of each stretch, shape (stretches,).
        chosen: Numbers of the stretches, some perhaps more than once.
    """
    times = np.bincount(chosen, minlength=len(expected))
    return max(by_chance(float(times**2 @ expected)) - float(times @ expected), 0.0)


def _confirming(parts: Sequence[NormalEquations]) -> list[NormalEquations]:
    """List the stretches on which a choice is confirmed: left out of the fit, and not reported either."""
    return [part for part in parts if part.heldout and not part.reported]


def _draws(rng: np.random.Generator, count: int) -> list[list[int]]:
    """Draw stretches with replacement."""
    return [rng.integers(0, count, count).tolist() for _ in range(DRAWS)]


def _gain(
    search: Search, before: Sequence[NormalEquations], after: Sequence[NormalEquations], chosen: Sequence[int]
) -> float:
    """Return by how much effects lower the cost of some held-out stretches."""
    seen = _marginaliser(search, [after[k] for k in chosen])
    return seen.renewed([before[k] for k in chosen]).cost - seen.cost


def _marginaliser(search: Search, parts: Sequence[NormalEquations]) -> Marginaliser:
    fraction = search.weights.effective_sample_fraction
    return Marginaliser.of(total(parts, search.evidence.size), search.prior, fraction)
