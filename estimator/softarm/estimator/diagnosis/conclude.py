"""From chosen effects to findings in words: their evidence, their rivals, and what exposes them."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.candidates import ChosenEffects
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.explanations import Explanations, rivals_of
from softarm.estimator.diagnosis.held_out import Predictions, held_out
from softarm.estimator.diagnosis.innovations import channel_errors, learnt_coefficients, residuals_of
from softarm.estimator.diagnosis.judge import bootstrap
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.diagnosis.probability import CREDIBLE
from softarm.estimator.diagnosis.result import (
    ChannelErrors,
    Evidence,
    Exposure,
    Finding,
    Heldout,
    Quantity,
    Rival,
    Unexplained,
)
from softarm.estimator.diagnosis.session import channels
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.diagnosis.unnamed import UnnamedLaw
from softarm.estimator.diagnosis.words import dependence, plain, sentence_on
from softarm.estimator.effects import EFFECTS, describe
from softarm.estimator.specimen.physics import Place


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
    rivals, rejected = rivals_of(search, accepted, explanations.each)
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
