"""How probable each explanation is of what the other findings leave, and which names may be stated."""

from collections.abc import Mapping, Set
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.diagnosis.candidates import Accepted, Candidate, ChosenEffects, includes
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.fit import Fit
from softarm.estimator.diagnosis.probability import (
    Explanation,
    credible_set,
    groups_of_alike,
    probabilities,
    shared,
)
from softarm.estimator.diagnosis.result import (
    Rejected,
    Rival,
)
from softarm.estimator.diagnosis.sizes import without_fragments
from softarm.estimator.diagnosis.unnamed import LIKELIER
from softarm.estimator.diagnosis.words import manoeuvre
from softarm.estimator.specimen.physics import EffectName

MANY = 2
"""Rivals of a finding from which no name is stated if none is likelier than not."""


@dataclass(frozen=True)
class Explanations:
    """How probable each of some effects is to explain what the other findings leave.

    Args:
        each: The probability of each.
        acts: That the accepted one acts: alone, or as part of a richer law.
        or_alike: That it acts, or another one that the recordings fit alike.
    """

    each: Mapping[Explanation, float]
    acts: float
    or_alike: float

    @classmethod
    def of(cls, search: Search, choice: ChosenEffects, index: int) -> "Explanations":
        """Weigh an accepted effect against its rivals, beside the other accepted ones."""
        fit, accepted = choice.fit, choice.accepted[index]
        assert fit is not None
        others = [k for k in range(len(fit.thetas)) if k != index]
        taken = {choice.accepted[k].candidate.number for k in others}
        field = [one for one in accepted.field if one.number not in taken and not one.fit.at_bound]
        rest = search.subset(fit, others)
        costs = [search.predicted(one, rest) for one in field]
        # Of its own draws, so that a probability is the same wherever it is asked for.
        weights = probabilities(field, costs, search.bic_penalty, np.random.default_rng(0))
        groups = groups_of_alike(field)
        shares = shared(weights, groups)
        each: dict[Explanation, float] = {}
        for one, weight in zip(field, shares.tolist(), strict=True):
            hypothesis = search.evidence.library.hypotheses[one.number]
            key = (hypothesis.name, hypothesis.place)
            each[key] = each.get(key, 0.0) + weight
        own = accepted.candidate
        same = np.array([one.number == own.number for one in field], dtype=bool)
        acts = same | [includes(one.fit, own.fit) for one in field]
        alike = acts | np.isin(groups, groups[same])
        return cls(each, min(float(shares[acts].sum()), 1.0), min(float(weights[alike].sum()), 1.0))


def without_improbable(
    search: Search, choice: ChosenEffects, sizes: Fit | None, disproved: Set[int] = frozenset()
) -> tuple[ChosenEffects, Fit | None, list[EffectName]]:
    """Of several effects, take back those that are no likelier than their rivals, and size the others anew.

    A rival that is likelier than not takes their place: what was taken back since they were chosen, as a lag
    beside a lost gain, may have stood for a part of it. What the law of a stronger effect leaves always has a
    likeliest name. A rival that is no likelier than not once all are fitted with it takes no place. A single
    effect stays, for something acts; whether its name is stated, see ``undecided``.

    Args:
        search: The search.
        choice: What it accepted.
        sizes: The same effects with their sizes; ``None`` where there are none.
        disproved: Numbers of those that confirming data have disproved.

    Returns:
        What is left of the choice, its sizes, and the names of what was taken back.
    """
    dropped: list[EffectName] = []
    refused, preferred = set(disproved), set[int]()
    while sizes is not None and len(choice.accepted) > 1:
        sized = replace(choice, fit=sizes)
        explained = {
            k: Explanations.of(search, sized, k)
            for k, one in enumerate(choice.accepted)
            if one.candidate.number not in preferred
        }
        weakest = min(explained, key=lambda k: explained[k].or_alike, default=None)
        if weakest is None or explained[weakest].or_alike > LIKELIER:
            break
        number = choice.accepted[weakest].candidate.number
        likelier = _likelier(search, choice.accepted[weakest], explained[weakest], refused)
        if likelier is None:
            dropped.append(sizes.hypotheses[weakest].name)
            other = search.without(choice, [weakest])
        else:
            other = search.exchanged(choice, weakest, likelier)
            if Explanations.of(search, other, weakest).or_alike <= LIKELIER:
                preferred.add(number)
                continue
        refused.add(number)
        choice = other
        choice, sizes, fragments = without_fragments(search, choice)
        dropped += fragments
    return choice, sizes, dropped


def _likelier(
    search: Search, accepted: Accepted, explained: Explanations, refused: Set[int]
) -> Candidate | None:
    """Return the rival of an effect that is likelier than not; none that was taken back before."""
    for rival in accepted.field:
        hypothesis = search.evidence.library.hypotheses[rival.number]
        share = explained.each.get((hypothesis.name, hypothesis.place), 0.0)
        if share > LIKELIER and rival.number not in refused:
            return rival
    return None


def undecided(search: Search, choice: ChosenEffects, unnamed: float) -> tuple[Rival, ...]:
    """List the effects of which one explains a mismatch, where they are many and none is likelier than not.

    Two that the recordings cannot distinguish are both named, as a finding and its rival. Of more, the name
    of the finding would be wrong more often than right.

    Args:
        search: The search.
        choice: What it accepted, with its sizes; none or several effects are never undecided.
        unnamed: Probability that what acts has no name.

    Returns:
        The accepted effect and its rivals; none where its name may be stated.
    """
    if choice.fit is None or len(choice.accepted) != 1:
        return ()
    explanations = Explanations.of(search, choice, 0)
    rivals, _ = rivals_of(search, choice.accepted[0], explanations.each)
    if len(rivals) < MANY or explanations.or_alike * (1.0 - unnamed) > LIKELIER:
        return ()
    own = choice.fit.hypotheses[0]
    return (Rival(own.name, own.place, rivals[0].manoeuvre, 0.0), *rivals)


def rivals_of(
    search: Search, accepted: Accepted, probable: Mapping[Explanation, float]
) -> tuple[tuple[Rival, ...], tuple[Rejected, ...]]:
    """List the effects that the recordings cannot distinguish from an accepted one, and those that they can.

    Args:
        search: The search.
        accepted: The effect.
        probable: How probable each explanation is.
    """
    winner = accepted.candidate
    hypothesis = search.evidence.library.hypotheses[winner.number]
    pneumatic = len(search.evidence.stages[0].world.pressure_limits) > 0
    credible = credible_set(probable)
    rivals: dict[str, Rival] = {}
    rejected: list[Rejected] = []
    for candidate in accepted.field:
        other = search.evidence.library.hypotheses[candidate.number]
        if candidate.number == winner.number:
            continue
        lost = (winner.delta_bic - candidate.delta_bic) / 2.0
        if (other.name, other.place) in credible and other.name != hypothesis.name:
            words = manoeuvre(hypothesis.name, other.name, pneumatic=pneumatic)
            rivals.setdefault(other.name, Rival(other.name, other.place, words, lost))
        else:
            rejected.append(Rejected(other.name, other.place, lost))
    return tuple(rivals.values()), tuple(sorted(rejected, key=lambda entry: entry.log_bayes_factor))
