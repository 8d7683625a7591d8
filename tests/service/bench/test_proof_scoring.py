"""The scorer of the proof counts what was named, where, and what was not."""

from pathlib import Path
from typing import Any

import pytest
import tomli_w

from softarm.bench.proof.schedule import PATTERN, SealedTrial, schedule
from softarm.bench.proof.score import SAME, Score, score
from softarm.bench.proof.tables import proof_tables, ran_table, wilson
from softarm.bench.proof.trial import Folders, Outcome, chosen, read_outcomes
from softarm.estimator.effects import EFFECTS
from softarm.estimator.errors import InputError


def conceal(folders: Folders, trial: SealedTrial, *effects: dict[str, Any]) -> None:
    folder = folders.answer(trial) / "run_00_ramps_hanging"
    folder.mkdir(parents=True)
    (folder / "truth.toml").write_text(tomli_w.dumps({"seed": 1, "effects": list(effects)}))


def lag(chamber: int = 2, time: float = 0.3) -> dict[str, Any]:
    parameters = {"time": {"value": time, "unit": "s"}}
    return {"effect": "line_lag", "where": {"chamber": chamber}, "parameters": parameters}


def finding(
    effect: str, rivals: tuple[str, ...] = (), value: float = 0.27, **where: object
) -> dict[str, Any]:
    place = dict.fromkeys(("segment", "chamber", "section", "sensor", "axis")) | where
    return {
        "effect": effect,
        "where": place,
        "parameters": {"lag": {"value": value, "std": 0.01, "unit": "s"}},
        "confusable_with": [{"effect": name, "where": place, "manoeuvre": "steps"} for name in rivals],
    }


def outcome(trial: SealedTrial, *findings: dict[str, Any], verdict: str = "explained") -> Outcome:
    heldout = {"normalised_rms_before": 3.0, "normalised_rms_after": 1.1}
    report = {"verdict": verdict, "findings": list(findings), "heldout": heldout}
    return Outcome(trial, "designed", 60.0, 600.0, 0, "", report)


def scored(
    tmp_path: Path, kind: str, hidden: list[dict[str, Any]], *findings: dict[str, Any], **more: Any
) -> Score:
    trial, folders = SealedTrial(kind, 1), Folders(tmp_path)
    conceal(folders, trial, *hidden)
    return score(outcome(trial, *findings, **more), folders)


def test_a_name_at_its_place_is_a_hit_with_its_error(tmp_path: Path):
    (hit,) = scored(tmp_path, "single", [lag()], finding("line_lag", chamber=2)).hits
    assert (hit.named, hit.placed, hit.in_set) == (True, True, True)
    assert hit.error == pytest.approx(0.1)


def test_a_name_at_another_place_is_no_hit_of_the_place(tmp_path: Path):
    (hit,) = scored(tmp_path, "single", [lag()], finding("line_lag", chamber=4)).hits
    assert (hit.named, hit.placed, hit.error) == (True, False, None)


def test_a_rival_in_the_set_counts_as_such_only(tmp_path: Path):
    found = scored(tmp_path, "single", [lag()], finding("inertia_damping", ("line_lag",)))
    (hit,) = found.hits
    assert (hit.named, hit.in_set, hit.taken_for) == (False, True, "inertia_damping")
    assert found.surplus == ()


def test_what_was_not_concealed_is_surplus(tmp_path: Path):
    found = scored(tmp_path, "single", [lag()], finding("line_lag", chamber=2), finding("base_tilt"))
    assert found.surplus == ("base_tilt",)


def test_null_trials_alarm_falsely_when_anything_is_named(tmp_path: Path):
    assert scored(tmp_path / "a", "null", [], finding("base_tilt")).false_alarm
    assert not scored(tmp_path / "b", "null", [], finding("unknown")).false_alarm


def test_foreign_effects_are_to_be_called_unknown(tmp_path: Path):
    hidden = [{"effect": "swirl", "where": {}, "parameters": {}}]
    assert scored(tmp_path / "a", "foreign", hidden, verdict="unexplained").called_unknown
    assert not scored(tmp_path / "b", "foreign", hidden, finding("fibre_twist")).called_unknown
    assert not scored(tmp_path / "c", "foreign", hidden, verdict="consistent").called_unknown


def test_a_trial_without_answer_is_not_scored(tmp_path: Path):
    with pytest.raises(InputError, match="holds no answer"):
        score(outcome(SealedTrial("null", 9)), Folders(tmp_path))


def test_tables_hold_every_failure_and_no_more(tmp_path: Path):
    good = scored(tmp_path / "a", "single", [lag()], finding("line_lag", chamber=2))
    bad = scored(tmp_path / "b", "null", [], finding("base_tilt"))
    failed = Outcome(SealedTrial("single", 1), "designed", 900.0, 600.0, -1, "ended", {})
    tables = {
        table.title: table for table in (*proof_tables([good, bad, score(failed, Folders(tmp_path / "a"))]),)
    }
    assert [row["said"] for row in tables["Trials that went wrong"].rows] == ["base_tilt", "ended"]
    counts = {row["what"]: row["count"] for row in tables["Sealed trials"].rows}
    assert counts["effects named and placed"] == 1
    assert counts["false alarms"] == 1
    assert ran_table([good, bad]).rows[0]["with_report"] == 2


def test_intervals_are_wilsons():
    low, high = wilson(0, 300)
    assert low == pytest.approx(0.0, abs=1e-12)
    assert high == pytest.approx(0.0126, abs=2e-4)
    assert wilson(9, 10) == pytest.approx((0.596, 0.982), abs=2e-3)
    assert wilson(0, 0) == (0.0, 1.0)


def test_the_schedule_keeps_its_shares_and_begins_alike():
    trials = schedule(40, 5000)
    assert [t.kind for t in trials] == list(PATTERN) * 2
    assert len({t.name for t in trials}) == 40
    assert schedule(10, 5000) == trials[:10]


def test_sizes_are_compared_where_the_estimator_has_the_parameter():
    for name, (_, parameter) in SAME.items():
        assert parameter in {p.name for p in EFFECTS[name].parameters}


def test_ordinary_motion_is_part_of_the_designed_and_the_pull_of_neither():
    names = (
        "nominal_00_ramps_hanging",
        "run_01_ramps_hanging",
        "run_06_steps_hanging",
        "run_09_pulled_steps_hanging",
    )
    paths = [Path(name) for name in names]
    assert [p.name for p in chosen(paths, "ordinary")] == ["run_01_ramps_hanging"]
    assert [p.name for p in chosen(paths, "designed")] == ["run_01_ramps_hanging", "run_06_steps_hanging"]


def test_results_are_read_as_they_were_written(tmp_path: Path):
    folders = Folders(tmp_path)
    one = outcome(SealedTrial("single", 3, "line_lag"), finding("line_lag", chamber=2))
    folders.results.write_text(one.line() * 2)
    assert read_outcomes(folders.results) == [one, one]
    assert read_outcomes(tmp_path / "none") == []
