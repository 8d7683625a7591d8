"""A run of trials that was killed goes on from its whole outcomes, as long as they are of the same trials."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from softarm.bench.trials import run
from softarm.bench.trials.folders import Trial
from softarm.bench.trials.outcome import TrialOutcome, add_outcome, read_outcomes
from softarm.estimator.errors import InputError

ONE = TrialOutcome("one", 12.5, 640.0, 0, "", {"verdict": "explained"})


def test_outcomes_are_read_as_they_were_written(tmp_path):
    path = tmp_path / "proof" / "results.jsonl"
    assert read_outcomes(path) == []
    other = replace(ONE, trial="two", status=-1, message="ended after 900 s", report={})
    add_outcome(ONE, path)
    add_outcome(other, path)
    assert read_outcomes(path) == [ONE, other]


def test_a_line_that_was_cut_off_is_done_again(tmp_path):
    path = tmp_path / "results.jsonl"
    add_outcome(ONE, path)
    path.write_text(path.read_text() + ONE.line()[:40])
    assert read_outcomes(path) == [ONE]
    add_outcome(replace(ONE, seconds=3.0), path)
    assert read_outcomes(path) == [ONE, replace(ONE, seconds=3.0)]


@pytest.mark.parametrize("line", ["nonsense", "[]", '{"trial": "one"}'])
def test_a_line_that_is_no_outcome_is_named(tmp_path: Path, line: str):
    path = tmp_path / "results.jsonl"
    path.write_text(f"{ONE.line()}{line}\n")
    with pytest.raises(
        InputError, match=r"results\.jsonl, line 2: is not the outcome of a trial; delete that line"
    ):
        read_outcomes(path)


def test_only_the_same_trial_with_a_report_is_not_diagnosed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    done: list[Path] = []
    reports = [{}, {"verdict": "explained"}, {"verdict": "consistent"}, {"verdict": "unexplained"}]

    def diagnose(trial: Trial, out: Path, extra: object) -> TrialOutcome:
        done.append(trial.questioned[0])
        return TrialOutcome(trial.name, 1.0, 10.0, 0, "", reports[len(done) - 1])

    def verdict_of(trial: Trial) -> str | None:
        (outcome,) = run.run_trials([trial], tmp_path / "out", 1, lambda _: None)
        return outcome.report.get("verdict")

    monkeypatch.setattr(run, "diagnose_trial", diagnose)
    one, other = (Trial("alike", "sopra", (), (tmp_path / name,)) for name in ("one.csv", "other.csv"))
    one.questioned[0].write_text("t_s,pressure_0_pa\n0,0\n")
    other.questioned[0].write_text("t_s,pressure_0_pa\n0,1\n")
    assert [verdict_of(one) for _ in range(3)] == [None, "explained", "explained"]  # the first one failed
    assert [verdict_of(other) for _ in range(2)] == ["consistent", "consistent"]
    assert verdict_of(one) == "unexplained"  # whose report the other one replaced
    assert done == [*one.questioned * 2, *other.questioned, *one.questioned]


def test_a_diagnosis_is_charged_for_the_processor_time_of_its_workers():
    busy = "import time\nwhile time.process_time() < 0.3: pass"
    code = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {busy!r}])\n"
    code += "print('first', file=sys.stderr); sys.exit('last')"
    status, last, core_s = run.run_in_time([sys.executable, "-c", code])
    assert (status, last) == (1, "last")
    assert core_s >= 0.3


def test_a_diagnosis_that_takes_too_long_is_ended(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(run, "TIME_LIMIT_S", 0.2)
    status, last, _ = run.run_in_time([sys.executable, "-c", "import time; time.sleep(60)"])
    assert (status, last) == (-1, "ended after 0.2 s")
