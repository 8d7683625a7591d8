"""The whole way from sessions to a diagnosis."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration.unknowns import Area
from softarm.estimator.diagnosis.candidates import ChosenEffects
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.conclude import findings_of, unknown
from softarm.estimator.diagnosis.confirm import proven
from softarm.estimator.diagnosis.detection import detection_limits
from softarm.estimator.diagnosis.events import EventErrors, event_errors
from softarm.estimator.diagnosis.evidence import RegressionProblem
from softarm.estimator.diagnosis.explanations import undecided, without_improbable
from softarm.estimator.diagnosis.form import form_columns
from softarm.estimator.diagnosis.held_out import error_over_expected, held_out, heldout_result
from softarm.estimator.diagnosis.innovations import before_and_after, worst_over_nominal, worst_stretch
from softarm.estimator.diagnosis.library import Hypothesis, Library, build_library, library_columns
from softarm.estimator.diagnosis.locate import locate
from softarm.estimator.diagnosis.motion import motions_of
from softarm.estimator.diagnosis.natural_frequency import natural_frequency_of
from softarm.estimator.diagnosis.nominal import evidence_of_change, passive, prior_before, suspects
from softarm.estimator.diagnosis.normal_equations import total
from softarm.estimator.diagnosis.nuisances import Nuisances, calibrate_sessions, only_drawn
from softarm.estimator.diagnosis.pose import with_poses
from softarm.estimator.diagnosis.probability import CREDIBLE
from softarm.estimator.diagnosis.result import (
    Baseline,
    Diagnosis,
    Finding,
    LocationMap,
    NotTestable,
    Rival,
    Unexplained,
    Verdict,
)
from softarm.estimator.diagnosis.screen import usual_gains
from softarm.estimator.diagnosis.session import Session, channels
from softarm.estimator.diagnosis.sizes import without_fragments
from softarm.estimator.diagnosis.split import excitation, hold_out
from softarm.estimator.diagnosis.stage import Model, Stage
from softarm.estimator.diagnosis.stuck import (
    find_stuck,
    stuck_findings,
    stuck_notes,
    without_repeated,
    without_stuck,
)
from softarm.estimator.diagnosis.swapped import refuse_swapped
from softarm.estimator.diagnosis.touches import find_touches, without_touches
from softarm.estimator.diagnosis.traces import traces_of
from softarm.estimator.diagnosis.unnamed import LIKELIER, UnnamedLaw, unnamed_law, unnamed_probability
from softarm.estimator.diagnosis.vibration import fit_vibration, with_vibration
from softarm.estimator.diagnosis.weights import Weights
from softarm.estimator.diagnosis.words import plain, possible
from softarm.estimator.effects import EFFECTS
from softarm.estimator.effects.placed import PlacedEffect
from softarm.estimator.errors import InputError
from softarm.estimator.intake import Disturbance
from softarm.estimator.intake.stuck_pressures import Stuck
from softarm.estimator.simulation.inertia import Masses
from softarm.estimator.specimen.physics import EffectName, Place

DETECTABLE = 25.0
"""Gain in cost of a typical effect below which the recordings cannot show it."""
STRUCTURE = 1.85
"""Root mean square of what is left, over that in nominal recordings, from which something is missing.

Its logarithm has mean 0.14 and deviation 0.15 in 49 unchanged arms of two simulators: 1 in 1000 leaves more.
"""
OUTLYING = 15.0
"""Error of the worst stretch, over that of the worst nominal one, from which something is missing.

Its logarithm has mean 0.9 and deviation 0.6 in 15 unchanged arms of two simulators: 1 in 1000 has more.
"""
CHANGED = 20.0
"""Twice the logarithm of the odds from which more has changed than from run to run ("very strong": Kass and
Raftery, J. Am. Stat. Assoc. 90 (1995) 773, use this term from 10)."""
SIGNIFICANT = 0.01
DOUBTFUL = 0.1
"""Chance, and least gain on single recordings, with which an effect that was turned down shows that
something is missing."""
DIRECT = frozenset({"command", "pressure", "gravity", "load"})
SOLVED = DIRECT | {"constitutive", "support", "sensing"}
"""Where effects enter the model that need few of its answers, and all where answers are fast."""


@dataclass(frozen=True)
class DiagnosisOutcome:
    """A diagnosis with what a caller may want to keep.

    Args:
        diagnosis: The result.
        accepted: The effects with their parameters.
        stds: Standard deviations of these.
        fitted: The calibration; ``None`` where only valves were recorded.
        covariance: Covariance of its unknowns, shape (unknowns, unknowns).
        event_errors: What the model with all findings leaves of the events of the recordings in question.
        touches: Stretches that were left out of every fit since nothing steady explains what a first model
            left of them, by the clock of the sessions.
    """

    diagnosis: Diagnosis
    accepted: tuple[PlacedEffect, ...]
    stds: tuple[tuple[float, ...], ...]
    fitted: Nuisances | None = None
    covariance: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    event_errors: tuple[EventErrors, ...] = ()
    touches: tuple[Disturbance, ...] = ()


def diagnose(
    model: Model,
    sessions: Sequence[Session],
    executor: Executor,
    *,
    seed: int = 0,
    notes: Sequence[str] = (),
    effects: Sequence[EffectName] | None = None,
    advance: Callable[[str], None] = lambda _: None,
    keep: Callable[["Assembled"], None] = lambda _: None,
) -> DiagnosisOutcome:
    """Find the physics that a model lacks.

    Args:
        model: The model of the specimen.
        sessions: Recordings in question and nominal ones, at the rate of the diagnosis.
        executor: Runs independent work.
        seed: Of everything random.
        notes: What was noticed of the recordings.
        effects: Effects to try; all when left out.
        advance: Is called with what is being done.
        keep: Is called with what is known before anything is looked for; again if touches were found.
    """

    def chosen(seen: Sequence[Session]) -> tuple[Assembled, Search, Decision]:
        assembled = assemble(model, seen, executor, effects, advance)
        keep(assembled)
        advance("fitting")
        search, decision = settled(
            assembled.evidence, seed, fast=model.fast, advance=lambda _: advance("fitting")
        )
        advance("judging")
        return assembled, search, decision

    assembled, search, decision = chosen(sessions)
    touches = find_touches(search, decision.choice.fit, model.specimen)
    if touches:
        del assembled, search  # together with those that follow they would fill twice the memory
        assembled, search, decision = chosen([without_touches(session, touches) for session in sessions])
    notes = (*notes, *assembled.notes, *_notes(search, decision.choice))
    if decision.dropped:
        dropped = ", ".join(decision.dropped)
        notes = (*notes, f"Fitted, but not proven and so not reported: {dropped}.")
    return replace(_outcome(search, decision, assembled, notes), touches=touches)


@dataclass(frozen=True)
class Assembled:
    """All that is known before anything is looked for.

    Args:
        evidence: Residuals and columns.
        stuck: Sensors that stood still.
        how: Which parts of the recordings are held out, in words.
        notes: What was noticed on the way.
    """

    evidence: RegressionProblem
    stuck: tuple[Stuck, ...]
    how: str
    notes: tuple[str, ...]


def assemble(
    model: Model,
    sessions: Sequence[Session],
    executor: Executor,
    effects: Sequence[EffectName] | None = None,
    advance: Callable[[str], None] = lambda _: None,
) -> Assembled:
    """Calibrate, predict and linearise; see ``diagnose``."""
    split, how = hold_out(sessions, np.array(model.specimen.pressure_limits))
    known = [session for session in split if session.nominal] or list(split)
    advance("calibrating")
    fitted = calibrate_sessions(model, [without_repeated(session) for session in known])
    advance("predicting")
    stages = tuple(fitted.stage(model, session) for session in split)
    _require_searched(stages, _no_equilibrium(stages))
    refuse_swapped(stages)
    stuck = tuple(one for stage in stages for one in find_stuck(stage))
    stages = tuple(
        without_stuck(stage, tuple(one for one in stuck if one.recording == stage.session.name))
        for stage in stages
    )
    _require_searched(stages, ("every sensor stands still while the model moves", "check that they are read"))
    masses = Masses.of(model.specimen, model.sections, stages[0].world.segments)
    nominal = [stage for stage in stages if stage.session.nominal]
    vibration, words = fit_vibration(nominal or stages, masses)
    if vibration is not None:
        stages = tuple(
            with_vibration(stage, vibration, masses, other=bool(nominal) and not stage.session.nominal)
            for stage in stages
        )
    library = build_library(
        _common_world(stages).world,
        np.concatenate([s.pressures for s in split]),
        effects,
        compared=bool(nominal),
        drawn=only_drawn(model.specimen, split),
        measured=not any(session.commanded for session in split),
    )
    advance("trying effects")
    changes = list(executor.map(_columns, [(stage, library) for stage in stages]))
    columns = tuple(
        np.concatenate([fitted.layout.jacobian(stage.prediction), form_columns(stage), own], axis=-1).astype(
            np.float32
        )
        for stage, own in zip(stages, changes, strict=True)
    )
    forms = columns[0].shape[-1] - len(fitted.values) - len(library.directions)
    residuals = tuple(stage.residual for stage in stages)
    evidence = RegressionProblem(model.specimen.name, stages, fitted, library, residuals, columns, forms)
    questioned = {stage.session.name for stage in stages if not stage.session.nominal}
    new = tuple(one for one in stuck if one.recording in questioned)
    before = stuck_notes([one for one in stuck if one.recording not in questioned])
    return Assembled(evidence, new, how, (*words, *before))


def begin(
    evidence: RegressionProblem,
    seed: int = 0,
    *,
    fast: bool,
    advance: Callable[[float], None] = lambda _: None,
) -> Search:
    """Learn the noise and what nominal recordings teach, and prepare the search.

    Args:
        evidence: Residuals and columns.
        seed: Of everything random.
        fast: Whether the model may be solved for every effect.
        advance: Called after each step of the search.
    """
    weights = evidence.weigh()
    suspected = suspects(evidence, weights)
    return _looking_for(evidence, weights, suspected, seed, fast=fast, advance=advance)


def _looking_for(
    evidence: RegressionProblem,
    weights: Weights,
    suspected: frozenset[EffectName],
    seed: int,
    *,
    fast: bool,
    advance: Callable[[float], None],
) -> Search:
    """Prepare the search with a noise model, for some suspected effects; see ``begin``."""
    prior, width = prior_before(evidence, weights, suspected)
    return Search(
        with_poses(passive(evidence, prior), weights, prior),
        weights,
        prior,
        np.random.default_rng(seed),
        width=width,
        solve=SOLVED if fast else DIRECT,
        natural_frequency=natural_frequency_of(evidence.stages),
        suspected=suspected,
        advance=advance,
    )


@dataclass(frozen=True)
class Decision:
    """What is reported, before it is put into words.

    Args:
        choice: The effects that are reported.
        dropped: Names of those that did not hold on data that confirm, or are no longer
            distinguishable from zero.
        law: A law without a name, where it outdoes the effects that were found.
        unnamed: Probability that what acts has no name.
        remainder: What no known effects explain, over the same of nominal recordings.
        changed: Whether the recordings in question have changed more than the effects explain; where there
            are none, whether more is left than of unchanged arms, or something without a name is likelier
            than not.
        seen_once: What would be reported, had the recordings shown it in more than one pose.
        one_of: Effects of which one acts, where none is likelier than not.
    """

    choice: ChosenEffects
    dropped: tuple[EffectName, ...]
    law: UnnamedLaw | None
    unnamed: float
    remainder: float
    changed: bool
    seen_once: Hypothesis | None = None
    one_of: tuple[Rival, ...] = ()

    @property
    def names(self) -> frozenset[EffectName]:
        """Names of the effects that are reported."""
        return frozenset(one.candidate.fit.hypotheses[-1].name for one in self.choice.accepted)

    def verdict(self, *, explained: bool) -> Verdict:
        """Put it into one word.

        Args:
            explained: Whether anything is reported.
        """
        if explained:
            return "partly_explained" if self.changed else "explained"
        return "unexplained" if self.changed else "consistent"


def decide(search: Search) -> Decision:
    """Choose the effects that are reported, and return whether something else is missing."""
    choice, unproven = proven(search)
    disproved = {one.candidate.number for one in unproven}
    choice, sizes, fragments = without_fragments(search, choice)
    choice, sizes, improbable = without_improbable(search, choice, sizes, disproved)
    unnamed = unnamed_law(search, choice.fit)
    law, probability = unnamed if unnamed.outdoes else None, unnamed.probability
    found, asked = choice.fit is not None, False
    if law is not None and not found:
        probability, asked = unnamed_probability(search, CHANGED, disproved), True
        law = replace(law, probability=probability) if probability >= CREDIBLE else None
    withdrawn = [one.candidate.fit.hypotheses[-1].name for one in unproven]
    withdrawn += [*fragments, *improbable]
    if found and probability > LIKELIER:
        choice, sizes = replace(choice, accepted=(), fit=None), None
        if law is None:  # neither it nor what it is likelier than is certain
            withdrawn += [one.name for one in unnamed.nearest]
    one_of = undecided(search, replace(choice, fit=sizes), probability)
    if one_of:
        choice, sizes = replace(choice, accepted=(), fit=None), None
    remainder = _remainder(search, choice)
    more_is_left = remainder > STRUCTURE or worst_over_nominal(search, choice.fit) > OUTLYING
    changed = law is not None or more_is_left or _changed(search, choice)
    if law is None and not found and (changed or unproven or _is_doubtful(choice)):
        probability = probability if asked else unnamed_probability(search, CHANGED, disproved)
        changed = more_is_left or probability > LIKELIER
    seen_once = None if choice.fit is not None else _seen_once(choice)
    return Decision(
        replace(choice, fit=sizes),
        tuple(withdrawn),
        law,
        probability,
        remainder,
        changed or seen_once is not None or bool(one_of),
        seen_once,
        one_of,
    )


def settled(
    evidence: RegressionProblem,
    seed: int = 0,
    *,
    fast: bool,
    advance: Callable[[float], None] = lambda _: None,
) -> tuple[Search, Decision]:
    """Search and decide; what was suspected and not found is then what any arm may have.

    Args:
        evidence: Residuals and columns.
        seed: Of everything random.
        fast: Whether the model may be solved for every effect.
        advance: Called after each step of the search.
    """
    search = begin(evidence, seed, fast=fast, advance=advance)
    decision = decide(search)
    while not search.suspected <= decision.names:
        suspected = search.suspected & decision.names
        search = _looking_for(evidence, search.weights, suspected, seed, fast=fast, advance=advance)
        decision = decide(search)
    return search, decision


def _seen_once(choice: ChosenEffects) -> Hypothesis | None:
    """Return the effect that was turned down only since the recordings show it in a single pose."""
    if choice.turned_down is None or not choice.turned_down[1].seen_once:
        return None
    return choice.turned_down[0].fit.hypotheses[-1]


def _is_doubtful(choice: ChosenEffects) -> bool:
    """Return whether an effect that was turned down shows that something is missing."""
    turned_down = choice.turned_down
    return turned_down is not None and turned_down[1].gain_ci95[0] > DOUBTFUL and choice.alarm_p < SIGNIFICANT


def _require_searched(stages: Sequence[Stage], problem_and_cure: tuple[str, str]) -> None:
    """Refuse recordings in question of which no reading is left to search."""
    suspects = [stage for stage in stages if not stage.session.nominal]
    if not any(np.isfinite(stage.residual[~stage.session.heldout]).any() for stage in suspects):
        raise InputError(", ".join(stage.session.name for stage in suspects), *problem_and_cure)


def _no_equilibrium(stages: Sequence[Stage]) -> tuple[str, str]:
    """Say why nothing is predicted of the recordings in question, and what to do."""
    suspects = [stage for stage in stages if not stage.session.nominal]
    if not any(np.isfinite(stage.reading_rows[~stage.session.heldout]).any() for stage in suspects):
        return "no reading is left outside held-out stretches", "record for longer, or with more sensors"
    return (
        "the model finds no equilibrium at the recorded pressures",
        "check the pressures' unit, or calibrate the specimen's moduli first",
    )


def _columns(work: tuple[Stage, Library]) -> NDArray[np.float32]:
    stage, library = work
    return library_columns(stage, library).astype(np.float32)


def _common_world(stages: Sequence[Stage]) -> Stage:
    """Return the stage with the most sensors."""
    return max(stages, key=lambda stage: len(stage.world.sensors))


def _notes(search: Search, choice: ChosenEffects) -> list[str]:
    known = [stage.session.name for stage in search.evidence.stages if stage.session.nominal]
    if known:
        return [
            f"The reference is {', '.join(known)}: what these recordings also show is not reported. Changes "
            f"of up to {search.width:.0%} of an effect's typical size occur from run to run and do not count."
        ]
    notes = [
        "No nominal recording was given: what any arm may have of itself is no finding, and what the model "
        "has always got wrong of this arm cannot be distinguished from a change of it."
    ]
    gains = usual_gains(search.evidence, search.left_free(choice.fit).marginal)
    usual = sorted((name for name in gains if gains[name] > CHANGED), key=lambda name: -gains[name])
    if usual:
        notes.append(f"These recordings show such a share of {', '.join(map(plain, usual))}.")
    if search.evidence.fitted.layout.of(Area).any():
        notes.append(
            "The specimen was never calibrated: moduli, and the areas that pressures push on, were "
            "calibrated on these recordings, so no change of them is sought."
        )
    return notes


def _outcome(
    search: Search, decision: Decision, assembled: Assembled, notes: Sequence[str]
) -> DiagnosisOutcome:
    evidence, choice, law = search.evidence, decision.choice, decision.law
    suspects = [stage for stage in evidence.stages if not stage.session.nominal]
    predictions = held_out(search, None, choice.fit, known=choice.fit is not None)
    findings = findings_of(search, choice, decision.unnamed)
    stuck = stuck_findings(assembled.stuck)
    first_map = _map(search, None)
    remaining_map = _map(search, choice) if choice.fit is not None else first_map
    baseline = _baseline(suspects, evidence.floors)
    verdict = decision.verdict(explained=bool(findings))
    before, after = before_and_after(search, choice.fit)
    heldout = heldout_result(search, choice.fit, predictions, before, after, assembled.how)
    unexplained = replace(
        _unexplained(verdict, heldout.after, remaining_map, law),
        over_nominal=decision.remainder if len(suspects) < len(evidence.stages) else None,
        worst=worst_stretch(search, after),
    )
    if verdict == "unexplained":
        missing = unknown(
            unexplained,
            heldout,
            choice.alarm_p,
            law,
            decision.unnamed,
            decision.seen_once,
            decision.one_of,
        )
        findings = (missing,)
    diagnosis = Diagnosis(
        specimen=evidence.specimen,
        recordings=tuple(stage.session.name for stage in suspects),
        nominal=tuple(stage.session.name for stage in evidence.stages if stage.session.nominal),
        verdict=verdict,
        baseline=baseline,
        map=first_map,
        findings=findings,
        heldout=heldout,
        unexplained=unexplained,
        not_testable=_not_testable(search, (*findings, *stuck)),
        detection_limits=detection_limits(search),
        notes=tuple(notes),
        traces=traces_of(search, before, after),
        motions=motions_of(evidence, before, after),
    ).with_faults(stuck)
    fit = choice.fit
    known = len(evidence.fitted.values)
    covariance = search.prior.covariance[:known, :known]
    events = event_errors(search, fit)
    if fit is None:
        return DiagnosisOutcome(diagnosis, (), (), evidence.fitted, covariance, events)
    world = _common_world(evidence.stages).world
    placed = tuple(h.placed(world, theta) for h, theta in zip(fit.hypotheses, fit.thetas, strict=True))
    stds = tuple(tuple(fit.stds(k).tolist()) for k in range(len(placed)))
    return DiagnosisOutcome(diagnosis, placed, stds, evidence.fitted, covariance, events)


def _baseline(stages: Sequence[Stage], floors: Mapping[str, float]) -> Baseline:
    squares: dict[str, list[Floats]] = {}
    kinds: dict[str, str] = {}
    for stage in stages:
        for row, (name, unit) in enumerate(zip(channels(stage.suite), stage.suite.units, strict=True)):
            column = stage.residual[:, row]
            squares.setdefault(name, []).append(column[np.isfinite(column)] ** 2)
            kinds[name] = unit
    rms = {
        name: float(np.sqrt(np.concatenate(parts).mean()))
        for name, parts in squares.items()
        if sum(map(len, parts))
    }
    normalised = [rms[name] / floors[name] for name in rms]
    whole = float(np.sqrt(np.mean(np.square(normalised)))) if normalised else 0.0
    return Baseline(rms, {name: floors[name] for name in rms}, kinds, whole)


def _remainder(search: Search, choice: ChosenEffects) -> float:
    """Return what the library cannot explain of the recordings in question, over the same of nominal ones.

    Without nominal recordings it is over the noise and what few samples leave open: then nothing shows that
    a mismatch is usual.
    """
    evidence, weights = search.evidence, search.weights
    remaining = evidence.leftover(weights, search.left(choice.fit).residuals, nominal=False)
    known = evidence.leftover(weights, evidence.residuals, nominal=True)
    return remaining / known if known > 0.0 else max(remaining, error_over_expected(search, choice.fit))


def _map(search: Search, choice: ChosenEffects | None) -> LocationMap:
    return locate(search.left(choice.fit if choice else None), search.rng)


def _changed(search: Search, choice: ChosenEffects) -> bool:
    """Return whether the recordings in question have changed more than the findings explain."""
    evidence, fraction = search.evidence, search.weights.effective_sample_fraction
    if not evidence.has_nominal:
        return False
    parts = [part for part in search.left(choice.fit).parts if not part.reported]
    return evidence_of_change(evidence, search.prior, search.width, parts, fraction) > CHANGED


def _unexplained(
    verdict: Verdict, after: float, location: LocationMap, law: UnnamedLaw | None
) -> Unexplained:
    if law is not None and law.regime:
        return Unexplained(after, law.place, law.regime, location)
    best = location.best
    if verdict in ("consistent", "explained") or best is None or best.p_value > SIGNIFICANT:
        return Unexplained(after, Place(), "", location)
    return Unexplained(after, best.place, best.regime, location)


def _not_testable(search: Search, findings: Sequence[Finding]) -> tuple[NotTestable, ...]:
    """List effects of which a typical size would not show anywhere.

    What was found or is a rival of a finding shows; what has no place on the arm, or was not tried, is not
    listed.
    """
    suspects = [stage.session for stage in search.evidence.stages if not stage.session.nominal]
    limits = _common_world(search.evidence.stages).world.pressure_limits
    there = excitation(suspects, limits)
    gains: dict[EffectName, float] = {effect.name: 0.0 for effect in EFFECTS.values()}
    data = total(search.left(None).searched, search.evidence.size)
    for column, direction in enumerate(search.evidence.library.directions):
        name = search.evidence.library.hypotheses[direction.hypothesis].name
        number = search.evidence.nuisances + column
        gains[name] = max(
            gains[name], search.weights.effective_sample_fraction * float(data.matrix[number, number])
        )
    untestable = []
    pneumatic = len(limits) > 0
    tried = {hypothesis.name for hypothesis in search.evidence.library.hypotheses}
    shown = {finding.effect for finding in findings}
    shown |= {rival.effect for finding in findings for rival in finding.confusable_with}
    for effect in EFFECTS.values():
        name = effect.name
        if gains[name] >= DETECTABLE or name in shown or name not in tried:
            continue
        lacking = possible(effect.needs - there, pneumatic=pneumatic)
        untestable.append(NotTestable(name, "; ".join(lacking) or "larger motion than was recorded"))
    return tuple(untestable)


__all__ = ["DiagnosisOutcome", "diagnose"]
