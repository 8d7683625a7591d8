"""The whole way from sessions to a diagnosis."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.diagnosis.belief import Belief
from estimator.diagnosis.calibration import calibrate_sessions
from estimator.diagnosis.choose import Choice, Search
from estimator.diagnosis.conclude import (
    findings_of,
    held_out,
    heldout_result,
    traces_of,
)
from estimator.diagnosis.evidence import Evidence
from estimator.diagnosis.form import form_columns
from estimator.diagnosis.gram import total
from estimator.diagnosis.library import Library, build_library, library_columns
from estimator.diagnosis.locate import locate
from estimator.diagnosis.nominal import belief_before
from estimator.diagnosis.result import (
    Baseline,
    Diagnosis,
    LocationMap,
    NotTestable,
    Unexplained,
    Verdict,
)
from estimator.diagnosis.session import Session, channels, units
from estimator.diagnosis.split import excitation, hold_out
from estimator.diagnosis.stage import Model, Stage
from estimator.diagnosis.weights import Weights
from estimator.diagnosis.words import EXCITATION
from estimator.effects import EFFECTS
from estimator.effects.augmented import PlacedEffect
from estimator.specimen.physics import EffectName, Place

Floats = NDArray[np.float64]

DETECTABLE = 25.0
"""Gain in cost of a typical effect below which the recordings cannot show it."""
STRUCTURE = 1.6
"""Root mean square of what is left, over that in nominal recordings, from which something is missing."""
SIGNIFICANT = 0.01


@dataclass(frozen=True)
class Outcome:
    """A diagnosis with what a caller may want to keep.

    Args:
        diagnosis: The result.
        accepted: The effects with their parameters.
        stds: Standard deviations of these.
    """

    diagnosis: Diagnosis
    accepted: tuple[PlacedEffect, ...]
    stds: tuple[tuple[float, ...], ...]


def diagnose(
    model: Model,
    sessions: Sequence[Session],
    executor: Executor,
    *,
    seed: int = 0,
    notes: Sequence[str] = (),
    advance: Callable[[str], None] = lambda _: None,
) -> Outcome:
    """Find the physics that a model lacks.

    Args:
        model: The model of the specimen.
        sessions: Recordings in question and nominal ones, at the rate of the diagnosis.
        executor: Runs independent work.
        seed: Of everything random.
        notes: What was noticed of the recordings.
        advance: Told what is being done.
    """
    rng = np.random.default_rng(seed)
    limits = np.array(model.specimen.pressure_limits)
    split, how = hold_out(sessions, limits)
    known = [session for session in split if session.nominal] or list(split)
    advance("calibrating")
    fitted = calibrate_sessions(model, known)
    advance("predicting")
    stages = tuple(fitted.stage(model, session) for session in split)
    library = build_library(_common_world(stages).world, np.concatenate([s.pressures for s in split]))
    advance("trying effects")
    changes = list(executor.map(_columns, [(stage, library) for stage in stages]))
    columns = tuple(
        np.concatenate([stage.calibration_columns(fitted.layout), form_columns(stage), own], axis=-1).astype(
            np.float32
        )
        for stage, own in zip(stages, changes, strict=True)
    )
    forms = columns[0].shape[-1] - len(fitted.vector) - len(library.directions)
    residuals = tuple(stage.residual for stage in stages)
    evidence = Evidence(stages, fitted, library, residuals, columns, forms)
    weights = evidence.weigh()
    belief, width = belief_before(evidence, weights)
    advance("fitting")
    search = Search(evidence, weights, belief, executor, rng, lambda _: advance("fitting"))
    choice = search.run()
    advance("judging")
    return _outcome(search, choice, how, (*notes, *_notes(width, known)), model)


def _columns(work: tuple[Stage, Library]) -> NDArray[np.float32]:
    stage, library = work
    return library_columns(stage, library).astype(np.float32)


def _common_world(stages: Sequence[Stage]) -> Stage:
    """Give the stage with the most sensors."""
    return max(stages, key=lambda stage: len(stage.world.sensors))


def _notes(width: float, known: Sequence[Session]) -> list[str]:
    if any(session.nominal for session in known):
        names = ", ".join(session.name for session in known)
        return [
            f"Judged against {names}: what they show as well is not reported; from run to run, "
            f"{width:.0%} of every effect's typical size counts as nothing new."
        ]
    return ["No nominal recording was given: the specimen itself is what the recordings are judged against."]


def _outcome(search: Search, choice: Choice, how: str, notes: Sequence[str], model: Model) -> Outcome:
    evidence, weights = search.evidence, search.weights
    suspects = [stage for stage in evidence.stages if not stage.session.nominal]
    before, after = search.parts(None), search.parts(choice.fit)
    predictions = held_out(search, before, after)
    findings = findings_of(search, choice)
    remainder = _remainder(search, choice)
    left_map = _map(search, choice) if findings else LocationMap()
    first_map = _map(search, None)
    baseline = _baseline(suspects, weights, predictions.rms()[0])
    verdict = _verdict(choice, remainder)
    unexplained = _unexplained(verdict, remainder, left_map if findings else first_map)
    diagnosis = Diagnosis(
        specimen=model.specimen.name,
        recordings=tuple(stage.session.name for stage in suspects),
        nominal=tuple(stage.session.name for stage in evidence.stages if stage.session.nominal),
        verdict=verdict,
        baseline=baseline,
        map=first_map,
        findings=findings,
        heldout=heldout_result(search, predictions, how),
        unexplained=unexplained,
        not_testable=_not_testable(search),
        notes=tuple(notes),
        traces=traces_of(search, choice),
    )
    fit = choice.fit
    if fit is None:
        return Outcome(diagnosis, (), ())
    world = _common_world(evidence.stages).world
    placed = tuple(h.placed(world, theta) for h, theta in zip(fit.hypotheses, fit.thetas, strict=True))
    return Outcome(diagnosis, placed, tuple(tuple(fit.stds(k).tolist()) for k in range(len(placed))))


def _baseline(stages: Sequence[Stage], weights: Weights, normalised: float) -> Baseline:
    squares: dict[str, list[Floats]] = {}
    kinds: dict[str, str] = {}
    for stage in stages:
        for row, (name, unit) in enumerate(zip(channels(stage.suite), units(stage.suite), strict=True)):
            column = stage.residual[:, row]
            squares.setdefault(name, []).append(column[np.isfinite(column)] ** 2)
            kinds[name] = unit
    rms = {
        name: float(np.sqrt(np.concatenate(parts).mean()))
        for name, parts in squares.items()
        if sum(map(len, parts))
    }
    return Baseline(rms, {name: weights.scale[name] for name in rms}, kinds, normalised)


def _remainder(search: Search, choice: Choice) -> float:
    """Give the rms that findings and common coefficients leave, over the same in nominal recordings.

    Without nominal recordings it is over the scatter that the fullest model leaves.
    """
    size = search.evidence.size
    parts = search.parts(choice.fit)
    common = search.belief.updated(
        total([p for p in parts if not p.heldout], size), search.weights.share
    ).mean
    left = sum(part.cost(common) for part in parts) / max(sum(part.count for part in parts), 1)
    nominal = [p for p in search.evidence.products(search.weights) if p.nominal]
    if not nominal:
        return float(np.sqrt(max(left, 0.0)))
    known = search.belief.updated(total(nominal, size), search.weights.share).mean
    floor = sum(part.cost(known) for part in nominal) / max(sum(part.count for part in nominal), 1)
    return float(np.sqrt(max(left, 0.0) / max(floor, 1e-12)))


def _map(search: Search, choice: Choice | None) -> LocationMap:
    evidence = search.evidence
    residuals = search.residuals(choice.fit if choice else None)
    chosen = [k for k, stage in enumerate(evidence.stages) if not stage.session.nominal]
    count = evidence.nuisances
    prior = Belief(search.belief.mean[:count], search.belief.covariance[:count, :count])
    common = search.belief.mean.copy()
    common[:count] = 0.0
    left = []
    for k in chosen:
        own = residuals[k] - evidence.columns[k] @ common
        own[evidence.stages[k].session.heldout] = np.nan
        left.append(own)
    return locate(
        [evidence.stages[k] for k in chosen],
        left,
        search.weights,
        [np.asarray(evidence.columns[k][..., :count], dtype=np.float64) for k in chosen],
        prior,
        search.rng,
    )


def _verdict(choice: Choice, remainder: float) -> Verdict:
    structured = remainder > STRUCTURE
    if choice.accepted:
        return "partly_explained" if structured else "explained"
    doubtful = choice.turned_down is not None and choice.turned_down[1].gain_ci95[0] > 0.1
    return "unexplained" if structured or (doubtful and choice.alarm_p < SIGNIFICANT) else "consistent"


def _unexplained(verdict: Verdict, remainder: float, found: LocationMap) -> Unexplained:
    best = found.best
    if verdict in ("consistent", "explained") or best is None or best.p_value > SIGNIFICANT:
        return Unexplained(remainder, Place(), "", found)
    return Unexplained(remainder, best.place, best.regime, found)


def _not_testable(search: Search) -> tuple[NotTestable, ...]:
    """List effects of which a typical size would not show anywhere."""
    suspects = [stage.session for stage in search.evidence.stages if not stage.session.nominal]
    limits = _common_world(search.evidence.stages).world.pressure_limits
    there = excitation(suspects, limits)
    parts = [part for part in search.parts(None) if not part.heldout]
    gains: dict[EffectName, float] = {effect.name: 0.0 for effect in EFFECTS.values()}
    seen = total(parts, search.evidence.size)
    for column, direction in enumerate(search.evidence.library.directions):
        name = search.evidence.library.hypotheses[direction.hypothesis].name
        own = search.evidence.nuisances + column
        gains[name] = max(gains[name], search.weights.share * float(seen.matrix[own, own]))
    found = []
    for effect in EFFECTS.values():
        name = effect.name
        if gains[name] >= DETECTABLE or name == "sensor_stuck":
            continue
        lacking = sorted(EXCITATION[need] for need in effect.needs - there)
        found.append(NotTestable(name, "; ".join(lacking) or "a larger response of the sensors"))
    return tuple(found)


__all__ = ["Outcome", "diagnose"]
