"""Trials of the fake arm: as many arms at a time as there are jobs, each diagnosed once."""

from pathlib import Path
from threading import Barrier

import pytest

from acceptance.proof.command import run_fake_trials
from acceptance.proof.schedule import schedule
from acceptance.proof.trial import Folders
from softarm.bench.trials import run
from softarm.bench.trials.folders import Trial
from softarm.bench.trials.outcome import TrialOutcome, read_outcomes


def test_arms_are_diagnosed_side_by_side_and_none_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    planned, folders, together = schedule(2, 7), Folders(tmp_path), Barrier(2, timeout=60.0)
    for trial in planned:
        for name in ("nominal_00_ramps_hanging", "run_00_ramps_hanging"):
            (folders.recordings(trial) / name).mkdir(parents=True)
        (folders.truth(trial) / "run_00_ramps_hanging").mkdir(parents=True)
        (folders.truth(trial) / "run_00_ramps_hanging" / "truth.toml").write_text("effects = []")

    def diagnose(trial: Trial, out: Path, extra: object) -> TrialOutcome:
        together.wait()  # passes only while another arm is being diagnosed
        return TrialOutcome(trial.name, 1.0, 10.0, 0, "", {"verdict": "consistent"})

    monkeypatch.setattr(run, "diagnose_trial", diagnose)
    for _ in range(2):
        run_fake_trials(planned, ("designed",), folders, 2, keep=True)
    names = sorted(outcome.trial for outcome in read_outcomes(folders.results))
    assert names == ["null_7_designed", "single_7_designed"]
