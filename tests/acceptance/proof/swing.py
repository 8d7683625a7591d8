"""How well the vibration of an arm that has changed is predicted, beside that of the same arm unchanged."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from acceptance.proof.schedule import SealedTrial
from acceptance.proof.sensitivity import products_of_trial
from acceptance.proof.trial import Folders, drawn, lay_out, record
from softarm.bench.trials.folders import Trial, read_answer
from softarm.common.tables import Cell, Table
from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.diagnose import begin
from softarm.estimator.diagnosis.fit import Fit, change_by
from softarm.estimator.diagnosis.screen import screen
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.diagnosis.vibration import OTHER_ARM, moved_by, steps_of
from softarm.estimator.specimen.physics import Place
from softarm.fakes.plant.generate import generate
from softarm.fakes.plant.write import write

RUNS = ("run_01", "run_10")
"""Random holds, hanging and sideways: after every step the arm vibrates."""


def swing_table(trials: Sequence[SealedTrial], folders: Folders, notify: Callable[[str], None]) -> Table:
    """Compare what is left of the vibration with what is concealed, fitted at its place, and without it.

    Args:
        trials: One effect is concealed in each.
        folders: Where the proof works; a run that was ended goes on from what is there.
        notify: Called with progress messages.
    """
    rows: list[dict[str, Cell]] = []
    for trial in trials:
        notify(f"{trial.name}: swing")
        rows += swing_rows(trial, folders)
    factors = [float(str(row["over_unchanged"])) for row in rows]
    median = f"{np.median(factors):.2g}" if factors else "unknown: no effect changes the arm"
    note = (
        "Rms change from sample to sample of what is left, over that of the vibration that the model gives "
        "the unchanged arm: with what was concealed, fitted at its place, and where nothing was. "
        f"over_unchanged: the one over the other, median {median}; the diagnosis takes {OTHER_ARM:g}."
    )
    return Table("The vibration of arms that have changed", rows, (note,))


def swing_rows(trial: SealedTrial, folders: Folders) -> list[dict[str, Cell]]:
    """Return a row for each of ``RUNS``; none where the effect is one of the sensors."""
    record(trial, folders)
    changed = lay_out(trial, "ordinary", folders)
    (concealed,) = read_answer(folders.answers, changed.name).concealed
    search = begin(products_of_trial(changed, folders.root / "products"), fast=True)
    fit = fitted(search, concealed.effect, concealed.where)
    if fit is None or fit.hypotheses[0].effect.hook == "sensing":
        return []
    unchanged = products_of_trial(
        unchanged_twin(trial, changed, folders), folders.root / "twins" / "products"
    )
    rows: list[dict[str, Cell]] = []
    for run in RUNS:
        stage, twin = (
            next(
                one for one in evidence.stages if one.session.name.startswith(run) and not one.session.nominal
            )
            for evidence in (search.evidence, unchanged)
        )
        left = [
            _size(one, residual) / _size(one, _vibrated(one))
            for one, residual in ((stage, stage.residual - change_by(stage, fit)), (twin, twin.residual))
        ]
        rows.append(
            {
                "trial": trial.name,
                "effect": concealed.effect,
                "recording": stage.session.name,
                "changed_percent": 100.0 * left[0],
                "unchanged_percent": 100.0 * left[1],
                "over_unchanged": left[0] / left[1],
            }
        )
    return rows


def unchanged_twin(trial: SealedTrial, changed: Trial, folders: Folders) -> Trial:
    """Record ``RUNS`` of the same arm, with the same noise, with nothing concealed in it."""
    out = folders.root / "twins" / "recordings" / trial.name
    for run in drawn(trial).runs:
        if run.name.startswith(RUNS) and not (out / run.name).exists():
            plain = replace(run.laboratory, concealed=())
            write(
                generate(plain, run.manoeuvre, run.seed),
                out / run.name,
                folders.truth(trial) / "twins" / run.name,
            )
    return replace(changed, questioned=tuple(sorted(path for path in out.iterdir() if path.is_dir())))


def fitted(search: Search, effect: str, where: Mapping[str, Any]) -> Fit | None:
    """Fit an effect at its place, beginning where the search would; ``None`` where no search knows it."""
    hypotheses = search.evidence.library.hypotheses
    numbers = {k for k, one in enumerate(hypotheses) if one.name == effect and _is_at(one.place, where)}
    problem = search.problem()
    ranked = search.at_size(screen(search.evidence, search.left(None).marginal, frozenset()), problem)
    field = search.finalists(problem, None, [entry for entry in ranked if entry[0] in numbers])
    return field[0].fit if field else None


def _is_at(place: Place, where: Mapping[str, Any]) -> bool:
    return all(
        getattr(place, part) in (None, where[part])
        for part in ("segment", "section", "chamber")
        if part in where
    )


def _vibrated(stage: Stage) -> Floats:
    """Return what the vibration of the unchanged arm changes of the readings, shape (samples, rows)."""
    assert stage.vibrations is not None, "the arm does not vibrate in these recordings"
    return moved_by(stage, stage.vibrations.couples)


def _size(stage: Stage, readings: Floats) -> float:
    """Return the rms change from sample to sample, in usual sizes."""
    return float(np.sqrt(np.nanmean(steps_of(stage, readings) ** 2)))
