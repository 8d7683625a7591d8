"""Trials of the fake arm: recorded, and laid out as anybody's sealed trials are."""

import json
import shutil
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w

from acceptance.proof.schedule import SealedTrial
from acceptance.trial import PlantTrial, draw, record_trial
from softarm.analysis.diagnosis.report import FILE
from softarm.bench.trials.folders import TRIAL_FILE, Trial, read_trial
from softarm.bench.trials.outcome import TrialOutcome
from softarm.bench.trials.run import RESULTS, WRITTEN, diagnose_trial
from softarm.common.errors import WorkFailedError
from softarm.estimator.errors import InputError
from softarm.fakes.plant.from_specimen import name_of_drawing

ORDINARY = ("random_holds", "ramps")
"""Manoeuvres that count as ordinary motion."""
FORCE_RUN = "pulled_steps"
LAST = "run_12"
"""Kept from diagnoses: the pull on which forces are estimated; the test of the alternatives."""


@dataclass(frozen=True)
class Folders:
    """Where a proof works.

    Args:
        root: Its folder.
    """

    root: Path

    @property
    def results(self) -> Path:
        """One JSON line per diagnosis."""
        return self.root / RESULTS

    @property
    def trials(self) -> Path:
        """Trials as ``softarm bench diagnosis`` reads them."""
        return self.root / "trials"

    @property
    def answers(self) -> Path:
        """One answer per trial; only the scorer opens them."""
        return self.root / "answers"

    def recordings(self, trial: SealedTrial) -> Path:
        """Recordings of a trial."""
        return self.root / "recordings" / trial.name

    def truth(self, trial: SealedTrial) -> Path:
        """What the fake arm concealed, apart from the recordings."""
        return self.root / "truth" / trial.name

    def report(self, name: str) -> Path:
        """What the diagnosis of a trial wrote."""
        return self.root / "reports" / name


def name_of(trial: SealedTrial, motion: str) -> str:
    """Return the name of a trial with the runs of one kind of motion; it does not hold the effect."""
    return f"{trial.name}_{motion}".replace(" ", "_")


def drawn(trial: SealedTrial) -> PlantTrial:
    """Draw the arm, the runs and what is concealed in a trial."""
    only = tuple(name for name in trial.only.split("+") if name)
    return draw(trial.seed, trial.kind, only=only, specimen=trial.specimen)


def record(trial: SealedTrial, folders: Folders) -> None:
    """Have the fake arm record a trial and seal its answer, unless that was done before."""
    out = folders.recordings(trial)
    if out.exists():
        return
    draft = out.with_suffix(".part")
    shutil.rmtree(draft, ignore_errors=True)
    record_trial(drawn(trial), draft, folders.truth(trial))
    for table in folders.truth(trial).rglob("*.csv"):
        table.unlink()
    draft.rename(out)


def lay_out(trial: SealedTrial, motion: str, folders: Folders) -> Trial:
    """Make a trial of the recordings of one kind of motion, by links, and write its answer.

    Args:
        trial: Which one; its recordings exist.
        motion: Which of its runs are in question; see ``chosen``.
        folders: Where.
    """
    name = name_of(trial, motion)
    folder = folders.trials / name
    every = sorted(path for path in folders.recordings(trial).iterdir() if path.is_dir())
    nominal = [path for path in every if path.name.startswith("nominal")]
    shutil.rmtree(folder, ignore_errors=True)
    for part, runs in (("nominal", nominal), ("questioned", chosen(every, motion))):
        (folder / part).mkdir(parents=True)
        for run in runs:
            (folder / part / run.name).symlink_to(run.resolve())
    (folder / TRIAL_FILE).write_text(tomli_w.dumps({"specimen": name_of_drawing(trial.specimen)}))
    folders.answers.mkdir(parents=True, exist_ok=True)
    answer = {"kind": trial.kind, "motion": motion, "concealed": concealed(folders.truth(trial))}
    (folders.answers / f"{name}.toml").write_text(tomli_w.dumps(answer))
    return read_trial(folder)


def concealed(truth: Path) -> list[dict[str, Any]]:
    """Read what the fake arm concealed in the runs in question, in the form of an answer.

    Raises:
        InputError: The truth is missing.
    """
    files = sorted(truth.glob("run_*/truth.toml"))
    if not files:
        raise InputError(str(truth), "holds no answer", "record the trial again")
    effects = tomllib.loads(files[0].read_text())["effects"]
    return [
        {
            "effect": effect["effect"],
            "where": effect["where"],
            "size": {name: one["value"] for name, one in effect["parameters"].items()},
        }
        for effect in effects
    ]


def diagnosed(
    trial: SealedTrial, motion: str, folders: Folders, notify: Callable[[str], None]
) -> TrialOutcome:
    """Record and diagnose a trial, unless its report and its specimen are there already.

    Raises:
        WorkFailedError: The diagnosis gave no report or wrote no specimen.
    """
    name = name_of(trial, motion)
    out = folders.report(name)
    if (out / FILE).exists() and (out / WRITTEN).exists():
        return TrialOutcome(name, 0.0, 0.0, 0, "", json.loads((out / FILE).read_text()))
    notify(f"{trial.name}: recording")
    record(trial, folders)
    notify(f"{trial.name}: diagnosing")
    extra = ("--write-specimen", str(out / WRITTEN))
    outcome = diagnose_trial(lay_out(trial, motion, folders), out, extra)
    if not outcome.report or not (out / WRITTEN).exists():
        raise WorkFailedError(f"softarm diagnose wrote no specimen ({outcome.message})")
    return outcome


def chosen(recordings: Sequence[Path], motion: str) -> list[Path]:
    """Choose the runs of a kind of motion among a trial's recordings; the pull is never among them."""
    runs = [p for p in recordings if p.name.startswith("run") and FORCE_RUN not in p.name]
    if motion == "designed":
        return runs
    if motion.startswith("first "):
        return runs[: int(motion.removeprefix("first "))]
    if motion == "hanging":
        return [path for path in runs if path.name.endswith("hanging") and not path.name.startswith(LAST)]
    return [path for path in runs if any(name in path.name for name in ORDINARY)]


def forget(trial: SealedTrial, folders: Folders) -> None:
    """Remove the recordings of a trial but the pull."""
    for path in folders.recordings(trial).iterdir():
        if FORCE_RUN not in path.name:
            shutil.rmtree(path)
