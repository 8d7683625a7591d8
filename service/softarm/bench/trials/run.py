"""Runs ``softarm diagnose`` on blind trials, each in a process of its own, and keeps the outcomes."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryFile
from threading import Event, Lock, Timer

from softarm.analysis.diagnosis.digest import digest_of
from softarm.analysis.diagnosis.report import FILE
from softarm.analysis.diagnosis.run import DiagnosisRequest
from softarm.bench.trials.folders import Trial
from softarm.bench.trials.outcome import TrialOutcome, add_outcome, read_outcomes
from softarm.estimator.errors import InputError
from softarm.estimator.specimen import load_specimen
from softarm.recordings import load_recording

RESULTS = "results.jsonl"
WRITTEN = "specimen.toml"
"""The improved specimen beside a report."""
TIME_LIMIT_S = 900.0
_WRITING = Lock()
"""Held while an outcome is added to a file."""


def run_trials(
    trials: Sequence[Trial],
    out: Path,
    jobs: int,
    advance: Callable[[float], None],
) -> list[TrialOutcome]:
    """Diagnose the trials that have no report yet.

    Args:
        trials: What to diagnose.
        out: Folder of reports and outcomes; a run that was ended goes on from what is there. A report counts
            only for the same recordings, specimen and program.
        jobs: Diagnoses at a time.
        advance: Called with 1 after each.

    Returns:
        The outcomes of all trials, those of earlier runs included.

    Raises:
        InputError: The specimen of a trial cannot be read.
    """
    results = out / RESULTS
    digests = {trial.name: _digest(trial) for trial in trials}
    latest = {outcome.trial: outcome for outcome in read_outcomes(results)}
    outcomes = {
        name: outcome
        for name, outcome in latest.items()
        if outcome.report and outcome.digest == digests.get(name)
    }

    def one(trial: Trial) -> None:
        report = out / "reports" / trial.name
        extra = ("--write-specimen", str(report / WRITTEN))
        outcome = replace(diagnose_trial(trial, report, extra), digest=digests[trial.name])
        with _WRITING:
            add_outcome(outcome, results)
        outcomes[trial.name] = outcome

    waiting = [trial for trial in trials if trial.name not in outcomes]
    advance(len(trials) - len(waiting))
    with ThreadPoolExecutor(jobs) as pool:
        for future in as_completed([pool.submit(one, trial) for trial in waiting]):
            future.result()
            advance(1)
    return [outcomes[trial.name] for trial in trials]


def _digest(trial: Trial) -> str:
    return digest_of(DiagnosisRequest(trial.questioned, trial.nominal, load_specimen(trial.specimen)))


def diagnose_trial(trial: Trial, out: Path, extra: Sequence[str] = ()) -> TrialOutcome:
    """Run ``softarm diagnose`` on one trial, on one core."""
    words = ["diagnose", *map(str, trial.questioned), "--specimen", trial.specimen]
    words += ["--jobs", "1", "--out", str(out), "--force", *extra]
    if trial.nominal:
        words += ["--nominal", *map(str, trial.nominal)]
    begin = time.monotonic()
    status, last, core_s = run_in_time([sys.executable, "-m", "softarm", *words])
    seconds = time.monotonic() - begin
    file = out / FILE
    report = json.loads(file.read_text()) if status == 0 and file.exists() else {}
    recorded = sum(_duration(path) for path in (*trial.nominal, *trial.questioned))
    return TrialOutcome(trial.name, seconds, recorded, status, "" if report else last, report, core_s=core_s)


def run_in_time(command: Sequence[str]) -> tuple[int, str, float]:
    """Run a command within ``TIME_LIMIT_S``.

    Returns:
        Its exit status, -1 when it was ended for its time; its last line on standard error; and the processor
        time of it and of the processes that it waited for [s].
    """
    late = Event()
    with (
        TemporaryFile() as said,
        subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said) as process,
    ):

        def end() -> None:
            late.set()
            process.kill()

        timer = Timer(TIME_LIMIT_S, end)
        timer.start()
        try:
            _, status, usage = os.wait4(process.pid, 0)
        finally:
            timer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        lines = said.read().decode(errors="replace").strip().splitlines()
    core_s = usage.ru_utime + usage.ru_stime
    if late.is_set():
        return -1, f"ended after {TIME_LIMIT_S:g} s", core_s
    return process.returncode, "".join(lines[-1:]), core_s


def _duration(path: Path) -> float:
    """Return the length of a recording [s]; 0 where it cannot be read, which the diagnosis has reported."""
    try:
        time_s = load_recording(path).time
    except InputError:
        return 0.0
    return float(time_s[-1] - time_s[0])
