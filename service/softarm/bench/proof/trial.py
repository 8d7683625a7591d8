"""One sealed trial: recorded by the fake arm, diagnosed by the command line, each a process of its own."""

import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from softarm.analysis.diagnosis.report import FILE
from softarm.bench.proof.schedule import SealedTrial
from softarm.common.errors import WorkFailedError

ORDINARY = ("random_holds", "ramps")
"""Manoeuvres that count as ordinary motion."""
FORCE_RUN = "pulled_steps"
LAST = "run_12"
"""Kept from diagnoses: the pull on which forces are estimated; the test of the alternatives."""
WRITTEN = "specimen.toml"
"""The improved specimen of a report."""
TIME_LIMIT_S = 900.0


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
        return self.root / "results.jsonl"

    def recordings(self, trial: SealedTrial) -> Path:
        """Recordings of a trial."""
        return self.root / "recordings" / trial.name

    def answer(self, trial: SealedTrial) -> Path:
        """The answer, apart from the recordings; only the scorer opens it."""
        return self.root / "answers" / trial.name

    def report(self, trial: SealedTrial, excitation: str) -> Path:
        """What the tool wrote."""
        return self.root / "reports" / f"{trial.name}_{excitation}".replace(" ", "_")


@dataclass(frozen=True)
class Outcome:
    """What one diagnosis of one trial gave.

    Args:
        trial: Kind and seed.
        excitation: ``designed`` or ``ordinary``.
        seconds: How long it took.
        recorded_s: How much recording it had.
        status: Exit status of the tool; -1 when it was ended for its time.
        told: Its last line on standard error when it failed.
        report: ``report.json`` as a table, empty when it failed.
    """

    trial: SealedTrial
    excitation: str
    seconds: float
    recorded_s: float
    status: int
    told: str
    report: dict[str, Any]

    def line(self) -> str:
        """Write it as one line of JSON."""
        return json.dumps({**vars(self), "trial": vars(self.trial)}) + "\n"


def add_outcome(outcome: Outcome, path: Path) -> None:
    """Add a result to those of earlier runs; what a run that was ended left of a line is overwritten."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab+") as file:
        file.seek(0)
        whole = file.read().rpartition(b"\n")
        file.truncate(len(whole[0]) + len(whole[1]))
        file.write(outcome.line().encode())


def read_outcomes(path: Path) -> list[Outcome]:
    """Read the results of earlier runs, whole lines only; none where there is no file."""
    if not path.exists():
        return []
    tables = [json.loads(line) for line in path.read_text().rpartition("\n")[0].splitlines() if line]
    return [Outcome(**{**table, "trial": SealedTrial(**table["trial"])}) for table in tables]


def record(trial: SealedTrial, folders: Folders) -> None:
    """Let the fake arm record a trial and seal its answer, unless that was done before.

    Raises:
        RuntimeError: It failed.
    """
    out = folders.recordings(trial)
    if out.exists():
        return
    draft = out.with_suffix(".part")
    shutil.rmtree(draft, ignore_errors=True)
    words = [
        str(draft),
        "--seed",
        str(trial.seed),
        "--kind",
        trial.kind,
        "--truth",
        str(folders.answer(trial)),
    ]
    words += [word for name in trial.only.split("+") if name for word in ("--only", name)]
    _run([sys.executable, "-m", "softarm.fakes.plant", "trial", *words])
    for table in folders.answer(trial).rglob("*.csv"):
        table.unlink()
    draft.rename(out)


def diagnose(
    trial: SealedTrial, excitation: str, folders: Folders, specimen: str, effects: Sequence[str] = ()
) -> Outcome:
    """Run ``softarm diagnose`` on the recordings of a trial.

    Args:
        trial: Which one; its recordings exist.
        excitation: Which of its runs to use.
        folders: Where.
        specimen: Name or path of the specimen that the tool is given: the drawing, not the arm.
        effects: Effects to try; all when empty.
    """
    every = sorted(path for path in folders.recordings(trial).iterdir() if path.is_dir())
    runs = chosen(every, excitation)
    nominal = [path for path in every if path.name.startswith("nominal")]
    out = folders.report(trial, excitation)
    words = ["diagnose", *map(str, runs), "--specimen", specimen, "--jobs", "1", "--out", str(out)]
    words += ["--write-specimen", str(out / WRITTEN), "--force"]
    for path in nominal:
        words += ["--nominal", str(path)]
    for effect in effects:
        words += ["--effect", effect]
    begin = time.monotonic()
    try:
        done = subprocess.run(
            [sys.executable, "-m", "softarm", *words],
            capture_output=True,
            text=True,
            check=False,
            timeout=TIME_LIMIT_S,
        )
        status, told = done.returncode, done.stderr.strip().splitlines()[-1:]
    except subprocess.TimeoutExpired:
        status, told = -1, [f"ended after {TIME_LIMIT_S:g} s"]
    seconds = time.monotonic() - begin
    file = out / FILE
    report = json.loads(file.read_text()) if status == 0 and file.exists() else {}
    recorded = sum(duration(path) for path in (*runs, *nominal))
    return Outcome(trial, excitation, seconds, recorded, status, "".join(told) if not report else "", report)


def diagnosed(
    trial: SealedTrial, excitation: str, folders: Folders, specimen: str, say: Callable[[str], None]
) -> Outcome:
    """Record and diagnose a trial, unless its report and its specimen are there already.

    Raises:
        WorkFailedError: The tool gave no report or wrote no specimen.
    """
    out = folders.report(trial, excitation)
    if (out / FILE).exists() and (out / WRITTEN).exists():
        return Outcome(trial, excitation, 0.0, 0.0, 0, "", json.loads((out / FILE).read_text()))
    say(f"{trial.name}: recording")
    record(trial, folders)
    say(f"{trial.name}: diagnosing")
    outcome = diagnose(trial, excitation, folders, specimen)
    if not outcome.report or not (out / WRITTEN).exists():
        raise WorkFailedError(f"softarm diagnose wrote no specimen ({outcome.told})")
    return outcome


def chosen(recordings: Sequence[Path], excitation: str) -> list[Path]:
    """Choose the runs of an excitation among a trial's recordings; the pull is never among them."""
    runs = [p for p in recordings if p.name.startswith("run") and FORCE_RUN not in p.name]
    if excitation == "designed":
        return runs
    if excitation.startswith("first "):
        return runs[: int(excitation.removeprefix("first "))]
    if excitation == "hanging":
        return [path for path in runs if path.name.endswith("hanging") and not path.name.startswith(LAST)]
    return [path for path in runs if any(name in path.name for name in ORDINARY)]


def duration(recording: Path) -> float:
    """Give the length of a recording by its last line [s]."""
    with (recording / "recording.csv").open("rb") as file:
        file.seek(0, 2)
        file.seek(max(0, file.tell() - 4096))
        return float(file.read().splitlines()[-1].split(b",")[0])


def forget(trial: SealedTrial, folders: Folders) -> None:
    """Remove the recordings of a trial but the pull."""
    for path in folders.recordings(trial).iterdir():
        if FORCE_RUN not in path.name:
            shutil.rmtree(path)


def _run(words: Sequence[str]) -> None:
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(words[:4])} failed: {done.stderr.strip()[-300:]}")
