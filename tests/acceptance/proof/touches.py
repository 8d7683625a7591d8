"""What three seconds of a hand do to a diagnosis: trials in which it moves the arm in one recording."""

import shutil
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from acceptance.proof.trial import Folders
from softarm.bench.trials.folders import Trial, read_answer
from softarm.bench.trials.outcome import TrialOutcome, add_outcome, read_outcomes
from softarm.bench.trials.run import RESULTS, diagnose_trial
from softarm.bench.trials.score import score
from softarm.common.tables import Cell, Table
from softarm.estimator.arrays import Floats
from softarm.estimator.recording import Recording
from softarm.estimator.rotations import exp, from_quaternions, to_quaternions
from softarm.recordings import load_recording, save_recording
from softarm.recordings.load import data_file

SECONDS, RAMP = 3.0, 0.4
"""How long a hand holds the arm, and how fast it gets there [s]."""
ANGLES = (0.1, 0.25)
"""Range of the angle by which it turns the tip [rad]."""
SHARES = {"intermediate": (0.5, 0.035), "tip": (1.0, 0.16)}
"""Turn of each section over that of the tip, and how far it moves with the tip's turn [m/rad]."""
AWAY = 0.1
"""Share of a recording at either end in which no touch begins."""


@dataclass(frozen=True)
class Touch:
    """A hand that moves the arm aside and lets it go.

    Args:
        run: Number of the recording in question.
        moment: When it begins, over the length of the recording.
        angle: Turn of the tip [rad].
        azimuth: To which side [rad].
    """

    run: int
    moment: float
    angle: float
    azimuth: float

    @staticmethod
    def drawn(trial: Trial) -> "Touch":
        """Draw the touch of a trial by its name."""
        random = np.random.default_rng(zlib.crc32(trial.name.encode()))
        run = int(random.integers(len(trial.questioned)))
        moment = random.uniform(AWAY, 1.0 - AWAY)
        return Touch(run, moment, random.uniform(*ANGLES), random.uniform(-np.pi, np.pi))

    def begin(self, recording: Recording) -> float:
        """Return when it begins [s]; it ends within the recording."""
        first, last = float(recording.time[0]), float(recording.time[-1])
        return first + self.moment * max(last - SECONDS - first, 0.0)

    def on(self, recording: Recording) -> Recording:
        """Return a recording with what its sensors of bends and frames would have read of it."""
        since = recording.time - self.begin(recording)
        turn = self.angle * np.clip(np.minimum(since, SECONDS - since) / RAMP, 0.0, 1.0)
        side = np.array([np.cos(self.azimuth), np.sin(self.azimuth)])
        columns = dict(recording.columns)
        for section, (share, lever) in SHARES.items():
            for k, axis in enumerate("xy"):
                _add(columns, f"bend_{section}_{axis}_rad", share * turn * side[k])
                _add(columns, f"frame_{section}_{axis}_m", lever * turn * side[k])
            names = [f"frame_{section}_q{letter}" for letter in "wxyz"]
            if names[0] in columns:
                axis_angle = np.outer(share * turn, [-side[1], side[0], 0.0])
                usual = from_quaternions(np.column_stack([columns[name] for name in names]))
                columns |= dict(zip(names, to_quaternions(exp(axis_angle) @ usual).T, strict=True))
        return replace(recording, columns=columns)


def touches_table(trials: Sequence[Trial], folders: Folders, notify: Callable[[str], None]) -> Table:
    """Diagnose trials in which a hand moves the arm in one recording.

    Args:
        trials: Those that were kept.
        folders: Where the proof works; a run that was ended goes on from what is there.
        notify: Called with progress messages.
    """
    root = folders.root / "touched"
    known = {one.trial: one for one in read_outcomes(root / RESULTS)}
    plain = {one.trial: one for one in read_outcomes(folders.results)}
    rows: list[dict[str, Cell]] = []
    for number, trial in enumerate(trials, start=1):
        touch = Touch.drawn(trial)
        if trial.name not in known:
            notify(f"a touch in {trial.name}, {number} of {len(trials)}")
            touched = touched_trial(trial, touch, root / "trials" / trial.name)
            known[trial.name] = diagnose_trial(touched, root / "reports" / trial.name)
            add_outcome(known[trial.name], root / RESULTS)
        rows.append(_row(trial, touch, known[trial.name], plain.get(trial.name), folders))
    found = sum(row["found"] == "yes" for row in rows)
    both = [row for row in rows if row["right without it"]]
    right, without = (sum(row[name] == "yes" for row in both) for name in ("right", "right without it"))
    note = (
        f"{found} of {len(rows)} touches are found. Of {len(both)} diagnoses {right} are right with a touch "
        f"and {without} without. A hand turns the tip by {np.degrees(ANGLES[0]):.0f} to "
        f"{np.degrees(ANGLES[1]):.0f} degrees for {SECONDS:g} s, in one recording in question."
    )
    return Table("Three seconds of a hand", rows, (note,))


def touched_trial(trial: Trial, touch: Touch, folder: Path) -> Trial:
    """Write a trial whose recordings are those of another, but for the one that is touched."""
    shutil.rmtree(folder, ignore_errors=True)
    path = trial.questioned[touch.run]
    copy = folder / path.name
    save_recording(touch.on(load_recording(path)), copy / data_file(path).name)
    questioned = (*trial.questioned[: touch.run], copy, *trial.questioned[touch.run + 1 :])
    return replace(trial, questioned=questioned)


def _row(
    trial: Trial, touch: Touch, outcome: TrialOutcome, plain: TrialOutcome | None, folders: Folders
) -> dict[str, Cell]:
    path = trial.questioned[touch.run]
    begin = touch.begin(load_recording(path))
    answer = read_answer(folders.answers, trial.name)
    events, others = _events(outcome.report, path.name, begin)
    left = replace(outcome, report={**outcome.report, "findings": others}) if outcome.report else outcome
    return {
        "trial": trial.name,
        "recording": path.name,
        "begins at s": begin,
        "degrees": float(np.degrees(touch.angle)),
        "found": "yes" if events else "no",
        "stated degrees": max((float(np.degrees(_angle(one))) for one in events), default=None),
        "verdict": str(outcome.report.get("verdict", "none")),
        "right": "yes" if score(left, answer).right else "no",
        "right without it": "" if plain is None else "yes" if score(plain, answer).right else "no",
    }


def _events(
    report: Mapping[str, Any], recording: str, begin: float
) -> tuple[list[Mapping[str, Any]], list[Mapping[str, Any]]]:
    """Sort findings by whether they are events while the hand acts."""
    events: list[Mapping[str, Any]] = []
    others: list[Mapping[str, Any]] = []
    for one in report.get("findings", []):
        first, last = one.get("interval") or (np.inf, -np.inf)
        during = one["effect"] == "event" and one.get("recording") == recording
        (events if during and first < begin + SECONDS and last > begin else others).append(one)
    return events, others


def _angle(finding: Mapping[str, Any]) -> float:
    return float(finding["parameters"].get("angle", {}).get("value", np.nan))


def _add(columns: dict[str, Floats], name: str, change: Floats) -> None:
    if name in columns:
        columns[name] = columns[name] + change
