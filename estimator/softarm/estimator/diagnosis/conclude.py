"""From a search to findings in words: evidence on held-out data, rivals, what is left and where."""

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.candidates import Accepted, Candidate, ChosenEffects, includes
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.fit import Fit, change_by
from softarm.estimator.diagnosis.gaussian import Factor
from softarm.estimator.diagnosis.innovations import (
    Residuals,
    channel_errors,
    innovation_test,
    learnt_coefficients,
    residuals_of,
    residuals_out_of_fold,
)
from softarm.estimator.diagnosis.judge import bootstrap
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.diagnosis.marginal import Marginaliser
from softarm.estimator.diagnosis.normal_equations import NewColumns, NormalEquations, added, total
from softarm.estimator.diagnosis.probability import (
    CREDIBLE,
    Explanation,
    credible_set,
    groups_of_alike,
    probabilities,
    shared,
)
from softarm.estimator.diagnosis.result import (
    ChannelErrors,
    Evidence,
    Exposure,
    Finding,
    Heldout,
    Quantity,
    Rejected,
    Rival,
    Unexplained,
)
from softarm.estimator.diagnosis.session import channels
from softarm.estimator.diagnosis.sizes import without_fragments
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.diagnosis.unnamed import LIKELIER, UnnamedLaw
from softarm.estimator.diagnosis.words import dependence, manoeuvre, plain, sentence_on
from softarm.estimator.effects import EFFECTS, describe
from softarm.estimator.specimen.physics import EffectName, Place

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
MANY = 2
"""Rivals of a finding from which no name is stated if none is likelier than not."""


@dataclass(frozen=True)
class Predictions:
    """Costs of held-out stretches without and with findings.

    Args:
        before: Weighted squares of each stretch without them.
        after: With them.
        counts: Residuals of each.
    """

    before: Floats
    after: Floats
    counts: Floats

    def rms(self) -> tuple[float, float]:
        """Return the normalised root mean squares before and after."""
        total_count = max(float(self.counts.sum()), 1.0)
        return (
            float(np.sqrt(max(self.before.sum(), 0.0) / total_count)),
            float(np.sqrt(max(self.after.sum(), 0.0) / total_count)),
        )


def held_out(search: Search, before: Fit | None, after: Fit | None, *, known: bool = False) -> Predictions:
    """Predict reported stretches without and with effects: those that have decided nothing.

    Common coefficients are those of the model with the effects, learnt outside these stretches. Squares are
    over the noise of quiet stretches; where the arm vibrates after fast changes they count less.

    Args:
        search: The search.
        before: Effects without those that are judged.
        after: Effects with them.
        known: Whether the model without effects is the one that was known before any of the recordings in
            question was seen.
    """
    learnt = learnt_coefficients(search, after)
    common = search.prior.mean if known else learnt
    first, counts = _squares(search, before, common)
    last, _ = _squares(search, after, learnt)
    return Predictions(first, last, counts)


def error_over_expected(search: Search, fit: Fit | None) -> float:
    """Return the rms of what is left of the confirming data, over what the model expects of its own errors.

    Errors e = r - C m have the covariance S = N + C P C^T, N of the noise of quiet stretches, P of the common
    coefficients that the searched stretches leave open: what few samples predict is uncertain, and to err so
    far is no sign that something is missing. By Woodbury's identity e^T S^-1 e = e^T N^-1 e - v^T (P^-1 + C^T
    N^-1 C)^-1 v, with v = C^T N^-1 e.
    """
    learnt = search.left(fit).folds.whole
    known = learnt.fraction * learnt.data.matrix + learnt.prior.precision
    cross, squares, count = np.zeros(len(learnt.mean)), 0.0, 0
    for number, residual in enumerate(search.left(fit).residuals):
        stage, columns = search.evidence.stages[number], search.evidence.columns[number]
        unseen = (stage.session.heldout & ~stage.session.reported)[:, None] & np.isfinite(residual)
        if stage.session.nominal or not unseen.any():
            continue
        scale = _over_noise(search, stage)[unseen]
        change = columns[unseen] * scale[:, None]
        error = residual[unseen] * scale - change @ learnt.mean
        known, cross = known + change.T @ change, cross + change.T @ error
        squares, count = squares + float(error @ error), count + len(error)
    return float(np.sqrt(max(squares - float(cross @ Factor.of(known).solve(cross)), 0.0) / max(count, 1)))


def _over_noise(search: Search, stage: Stage) -> Floats:
    """Return one over the noise of quiet stretches, less where the model is unsure, shape (samples, rows)."""
    names = channels(stage.suite)
    row = search.weights.stds(names)
    calm: Floats = row / stage.error_std(row) / [search.evidence.floors[name] for name in names]
    return calm


def _squares(search: Search, fit: Fit | None, common: Floats) -> tuple[Floats, Floats]:
    """Return the squares over the noise, and their number, of each reported stretch."""
    squares: list[float] = []
    counts: list[float] = []
    for number, residual in enumerate(search.left(fit).residuals):
        stage = search.evidence.stages[number]
        session = stage.session
        unseen = session.reported
        if session.nominal or not unseen.any():
            continue
        squared = ((residual - search.evidence.columns[number] @ common) * _over_noise(search, stage)) ** 2
        for block in np.unique(session.blocks[unseen]):
            chosen = squared[(session.blocks == block) & unseen]
            squares.append(float(np.nansum(chosen)))
            counts.append(float(np.isfinite(chosen).sum()))
    return np.array(squares), np.array(counts)


def heldout_result(
    search: Search, fit: Fit | None, predictions: Predictions, before: Residuals, after: Residuals, how: str
) -> Heldout:
    """Judge the whole model on held-out data.

    Args:
        search: The search.
        fit: All findings.
        predictions: Costs of held-out stretches without and with them.
        before: Residuals of each session without them, shape (samples, rows).
        after: The same with them.
        how: In words, which data these are.
    """
    rms_before, rms_after = predictions.rms()
    interval = (0.0, 0.0)
    if len(predictions.before) > 1 and not np.array_equal(predictions.before, predictions.after):
        interval = bootstrap(search.rng, predictions.before, predictions.after)
    errors = channel_errors(search, before, after)
    test = innovation_test(search, after, residuals_out_of_fold(search, fit))
    return Heldout(rms_before, rms_after, interval, how, errors, test)


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
    rivals, _ = _rivals(search, choice.accepted[0], explanations.each)
    if len(rivals) < MANY or explanations.or_alike * (1.0 - unnamed) > LIKELIER:
        return ()
    own = choice.fit.hypotheses[0]
    return (Rival(own.name, own.place, rivals[0].manoeuvre, 0.0), *rivals)


def findings_of(search: Search, choice: ChosenEffects, unnamed: float) -> tuple[Finding, ...]:
    """Describe every accepted effect with its evidence; the one that explains most comes first.

    Args:
        search: The search.
        choice: What it accepted.
        unnamed: Probability that what acts has no name.
    """
    fit = choice.fit
    if fit is None:
        return ()
    findings: list[tuple[float, Finding]] = []
    for index in range(len(choice.accepted)):
        others = [k for k in range(len(fit.hypotheses)) if k != index]
        rest = search.subset(fit, others)
        predictions = held_out(search, rest, fit)
        gain = float(predictions.before.sum() - predictions.after.sum())
        learnt = learnt_coefficients(search, fit)
        errors = channel_errors(search, residuals_of(search, rest, learnt), residuals_of(search, fit, learnt))
        findings.append((gain, _finding(search, choice, index, predictions, errors, unnamed)))
    return tuple(finding for _, finding in sorted(findings, key=lambda entry: -entry[0]))


def unknown(
    unexplained: Unexplained,
    heldout: Heldout,
    search_p: float,
    law: UnnamedLaw | None,
    probability: float,
    seen_once: Hypothesis | None = None,
    one_of: tuple[Rival, ...] = (),
) -> Finding:
    """Report that something is missing which no known effect explains for certain.

    Args:
        unexplained: Where it sits and what it varies with, as far as that is known.
        heldout: The error on held-out data, which nothing lowers.
        search_p: Chance that the whole search finds as much where nothing is missing.
        law: A law without a name that outdoes the effects that were found, where it does.
        probability: Posterior probability that what is missing has no name.
        seen_once: What explains it, but in a single pose.
        one_of: Effects of which one explains it, but none likelier than not.
    """
    sits = (
        f" They differ most at {describe(unexplained.where)}, and {dependence(unexplained.when)}."
        if unexplained.when
        else ""
    )
    differ = "Model and recordings differ, and no known effect improves the prediction of unseen data."
    rivals = one_of
    if one_of:
        differ = (
            f"Model and recordings differ. Any of {len(one_of)} known effects would explain it, and none of "
            "them is likelier than not."
        )
    elif law is None and seen_once is not None:
        name, place = seen_once.name, seen_once.place
        differ = (
            f"Model and recordings differ. A known effect would explain it, {plain(name)} of "
            f"{describe(place)}, but these recordings show it in a single pose, and of one pose the model "
            "may be wrong."
        )
        rivals = (Rival(name, place, "the same in several other poses", 0.0),)
    odds = 0.0 if law is None else 0.5 * (law.gain - law.named_gain)
    if law is not None and probability < CREDIBLE:
        words = "the same in other poses and at other pressures, which a right name predicts"
        rivals = tuple(Rival(one.name, one.place, words, odds) for one in law.nearest)
    return Finding(
        effect="unknown",
        where=unexplained.where,
        when=unexplained.when,
        statement=(differ if law is None else law.sentence()) + ("" if law and law.regime else sits),
        parameters={},
        evidence=Evidence(odds, heldout.before, heldout.after, (0.0, 0.0), search_p),
        confusable_with=rivals,
        probability=None if law is None and rivals else probability,
    )


def _finding(
    search: Search,
    choice: ChosenEffects,
    index: int,
    predictions: Predictions,
    errors: ChannelErrors,
    unnamed: float,
) -> Finding:
    fit, accepted = choice.fit, choice.accepted[index]
    assert fit is not None
    hypothesis, theta, stds = fit.hypotheses[index], fit.thetas[index], fit.stds(index)
    effect = hypothesis.effect
    before, after = predictions.rms()
    low, high = 0.0, 0.0
    if len(predictions.before) > 1:
        low, high = bootstrap(search.rng, predictions.before, predictions.after)
    explanations = Explanations.of(search, choice, index)
    rivals, rejected = _rivals(search, accepted, explanations.each)
    when = effect.when
    statement = f"{effect.sentence(theta, hypothesis.place)} {sentence_on(when)}"
    return Finding(
        effect=effect.name,
        where=hypothesis.place,
        when=when,
        statement=statement,
        parameters={
            effect.reported(p, hypothesis.place): Quantity(
                float(value), float(std), effect.unit(p, hypothesis.place)
            )
            for p, value, std in zip(effect.parameters, theta, stds, strict=True)
        },
        evidence=Evidence(
            accepted.candidate.delta_bic / 2.0,
            before,
            after,
            (low, high),
            accepted.judgement.search_p,
            errors,
        ),
        confusable_with=rivals,
        rejected=rejected,
        exposure=_exposure(search, choice, index),
        probability=explanations.acts * (1.0 - unnamed),
    )


def _rivals(
    search: Search, accepted: Accepted, probable: Mapping[Explanation, float]
) -> tuple[tuple[Rival, ...], tuple[Rejected, ...]]:
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


def _exposure(search: Search, choice: ChosenEffects, index: int) -> Exposure | None:
    """Show the residual of the channel that a finding improves most against what exposes it."""
    fit = choice.fit
    assert fit is not None
    others = [k for k in range(len(fit.hypotheses)) if k != index]
    before = search.left(search.subset(fit, others)).residuals
    after = search.left(fit).residuals
    best: tuple[float, int, int] | None = None
    for number, stage in enumerate(search.evidence.stages):
        if stage.session.nominal:
            continue
        scale = search.weights.stds(search.evidence.names[number])
        gains = np.nansum((before[number] / scale) ** 2 - (after[number] / scale) ** 2, axis=0)
        row = int(np.argmax(gains))
        if best is None or gains[row] > best[0]:
            best = (float(gains[row]), number, row)
    if best is None:
        return None
    _, number, row = best
    stage = search.evidence.stages[number]
    name, unit, values = exposing_variable(stage, fit.hypotheses[index].name, fit.hypotheses[index].place)
    return Exposure(
        name,
        unit,
        f"{stage.session.name}: {channels(stage.suite)[row]}",
        stage.suite.units[row],
        values,
        before[number][:, row],
        after[number][:, row],
    )


def exposing_variable(stage: Stage, name: str, place: Place) -> tuple[str, str, Floats]:
    """Return the variable against which an effect's residual shows best: its name, unit and values."""
    regime = EFFECTS[name].when
    session = stage.session
    if regime == "pressure level":
        if place.chamber is not None:
            return f"pressure of chamber {place.chamber}", "Pa", session.pressures[:, place.chamber]
        return "highest pressure", "Pa", session.pressures.max(axis=1, initial=0.0)
    if regime in ("rate", "direction of change") and session.pressures.size:
        speed = np.gradient(session.pressures, session.clock, axis=0)
        if place.chamber is not None:
            return f"rate of pressure of chamber {place.chamber}", "Pa/s", speed[:, place.chamber]
        return "rate of the pressures' sum", "Pa/s", speed.sum(axis=1)
    if regime in ("pose", "largest strain so far"):
        bend = np.linalg.norm(stage.arm.baseline.strains[..., :2], axis=-1)[:, -1]
        return "bend of the last segment", "rad", bend
    return "time", "s", session.time
