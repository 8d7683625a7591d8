"""``softarm excite``: plans without an arm, and what it refuses."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softarm.analysis.diagnosis.motion import specimen_file
from softarm.analysis.diagnosis.report import report_of
from softarm.cli import run
from softarm.cli.excite import plan_tables, shortened
from softarm.estimator.excitation import ChosenManoeuvre, ExcitationPlan, Manoeuvre
from softarm.estimator.specimen import load_specimen, save_specimen
from softarm.experiments.excitation_plan import count_of_pairs, manoeuvres_of
from tests.service.diagnosis.made_diagnosis import diagnosis


def choice(seconds: float) -> ChosenManoeuvre:
    path = Manoeuvre("short", "nothing", np.array([0.0, seconds]), np.zeros((2, 6)))
    return ChosenManoeuvre(path)


def test_a_dry_run_prints_all_manoeuvres(capsys: pytest.CaptureFixture[str]):
    assert run(["excite", "--dry-run", "--specimen", "sopra", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert {"growing_cycles", "steps", "poses"} <= {row["manoeuvre"] for row in rows}
    assert not any(row["manoeuvre"].startswith("mount_turned") for row in rows)


@pytest.mark.parametrize(
    ("words", "status", "told"),
    [
        ([], 2, "give either --arm ID"),
        (["--arm", "sopra", "--fake"], 2, "give either --arm ID"),
        (["--dry-run", "--manoeuvre", "dance"], 2, "choose from: growing_cycles"),
        (["--dry-run", "--report", "/nonexistent"], 2, "there is no such report"),
        (["--arm", "nobody", "--endpoint", "tcp/127.0.0.1:1"], 1, "tcp/127.0.0.1:1"),
    ],
)
def test_errors_are_one_line(words: list[str], status: int, told: str, capsys: pytest.CaptureFixture[str]):
    assert run(["excite", *words]) == status
    said = capsys.readouterr().err.strip()
    assert told in said
    assert "\n" not in said


def test_a_report_of_another_specimen_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "report.json").write_text(report_of(diagnosis()).dump())
    assert run(["excite", "--dry-run", "--specimen", "single_segment", "--report", str(tmp_path)]) == 2
    assert "give the specimen that was diagnosed" in capsys.readouterr().err


def test_a_report_on_a_specimen_of_ones_own_is_planned_on_what_was_kept(tmp_path: Path):
    found = replace(diagnosis(), specimen="mine", findings=())
    (tmp_path / "report.json").write_text(report_of(found).dump())
    own = load_specimen("beam").model_copy(update={"name": "mine"})
    save_specimen(own, specimen_file(tmp_path))
    for report in (tmp_path, tmp_path / "report.json"):
        assert run(["excite", "--dry-run", "--report", str(report)]) == 0


def test_a_plan_is_cut_to_the_time_there_is():
    plan = ExcitationPlan((choice(50.0), choice(100.0), choice(20.0)))
    assert [one.manoeuvre.duration for one in shortened(plan, 90.0 / 60.0).choices] == [50.0, 20.0]
    assert shortened(plan, None) == plan
    assert len(plan_tables(plan)[0].rows) == 3


def test_pairs_of_a_report_are_counted():
    report = report_of(diagnosis())
    assert count_of_pairs(report) == 1
    assert count_of_pairs(None) == 0


def test_someone_must_be_there_to_turn_the_mount():
    beam = load_specimen("beam")
    assert [m.name for m in manoeuvres_of(beam)] == ["rest"]
    assert "mount_turned_x" in {m.name for m in manoeuvres_of(beam, by_hand=True)}
    slow = manoeuvres_of(load_specimen("sopra"), ("steps",), slew=20e3)[0]
    assert np.abs(np.diff(slow.pressures, axis=0) / np.diff(slow.times)[:, None]).max() <= 20e3 * 1.000001
