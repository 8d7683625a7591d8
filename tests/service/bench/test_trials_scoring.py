"""The scorer counts what was named, where, how large and how surely, and what was not."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acceptance.proof.schedule import PATTERN, schedule
from acceptance.proof.trial import chosen
from softarm.bench.trials.folders import Answer, Concealment
from softarm.bench.trials.outcome import TrialOutcome
from softarm.bench.trials.score import COUNTERPARTS, Score, score
from softarm.bench.trials.tables import limits, reliability, score_tables, wilson
from softarm.estimator.effects import EFFECTS

LAG = Concealment(effect="line_lag", where={"chamber": 2}, size={"time": 0.3})


def finding(
    effect: str,
    rivals: tuple[str, ...] = (),
    value: float = 0.27,
    std: float = 0.01,
    probability: float | None = None,
    **where: object,
) -> dict[str, Any]:
    place = dict.fromkeys(("segment", "chamber", "section", "sensor", "axis")) | where
    return {
        "effect": effect,
        "where": place,
        "parameters": {"lag": {"value": value, "std": std, "unit": "s"}},
        "probability": probability,
        "confusable_with": [{"effect": name, "where": place, "manoeuvre": "steps"} for name in rivals],
    }


def outcome(*findings: dict[str, Any], verdict: str = "explained") -> TrialOutcome:
    heldout = {"normalised_rms_before": 3.0, "normalised_rms_after": 1.1}
    report = {"verdict": verdict, "findings": list(findings), "heldout": heldout}
    return TrialOutcome("one", 60.0, 600.0, 0, "", report)


def scored(kind: str, hidden: tuple[Concealment, ...], *findings: dict[str, Any], **more: Any) -> Score:
    return score(
        outcome(*findings, **more),
        Answer.model_validate({"kind": kind, "concealed": hidden, "motion": "designed"}),
    )


def test_a_name_at_its_place_is_a_hit_with_its_error():
    (hit,) = scored("single", (LAG,), finding("line_lag", chamber=2)).hits
    assert (hit.named, hit.placed, hit.in_set) == (True, True, True)
    assert hit.error == pytest.approx(0.1)


def test_what_was_missed_is_compared_with_the_limit_that_the_report_states():
    where = dict.fromkeys(("segment", "section", "sensor", "axis"))
    limits = [
        {"effect": "line_lag", "where": where | {"chamber": chamber}, "parameter": "lag", "size": size}
        for chamber, size in ((None, 0.1), (2, 0.4))
    ]
    one = outcome(verdict="consistent")
    found = score(
        replace(one, report=one.report | {"detection_limits": limits}),
        Answer(kind="single", concealed=(LAG,)),
    )
    assert [hit.over_limit for hit in found.hits] == pytest.approx([0.75])
    (row,) = next(t for t in score_tables([found]) if t.title == "Trials that went wrong").rows
    assert row["missed, size over limit"] == "line_lag 0.75"


def test_a_name_at_another_place_is_no_hit_of_the_place():
    (hit,) = scored("single", (LAG,), finding("line_lag", chamber=4)).hits
    assert (hit.named, hit.placed, hit.error) == (True, False, None)


def test_a_rival_in_the_set_counts_as_such_only():
    found = scored("single", (LAG,), finding("inertia_damping", ("line_lag",)))
    (hit,) = found.hits
    assert (hit.named, hit.in_set, hit.taken_for) == (False, True, "inertia_damping")
    assert found.surplus == ()


def test_what_was_not_concealed_is_surplus():
    found = scored("single", (LAG,), finding("line_lag", chamber=2), finding("base_tilt"))
    assert found.surplus == ("base_tilt",)


def test_null_trials_alarm_falsely_when_anything_is_named():
    assert scored("null", (), finding("base_tilt")).false_alarm
    assert not scored("null", (), finding("unknown")).false_alarm


def test_foreign_effects_are_to_be_called_unknown():
    hidden = (Concealment(effect="swirl"),)
    assert scored("foreign", hidden, verdict="unexplained").called_unknown
    assert not scored("foreign", hidden, finding("fibre_twist")).called_unknown
    assert scored("foreign", hidden, finding("unknown"), finding("event")).called_unknown
    assert not scored("foreign", hidden, verdict="consistent").called_unknown


def test_tables_hold_every_failure_and_no_more():
    good = scored("single", (LAG,), finding("line_lag", chamber=2))
    bad = scored("null", (), finding("base_tilt"))
    failed = score(
        TrialOutcome("two", 900.0, 600.0, -1, "ended", {}),
        Answer(kind="single", concealed=(LAG,), motion="designed"),
    )
    tables = {table.title: table for table in score_tables([good, bad, failed])}
    assert [row["said"] for row in tables["Trials that went wrong"].rows] == ["base_tilt", "ended"]
    counts = {row["what"]: row["count"] for row in tables["Blind trials"].rows}
    assert counts["effects named and placed"] == 1
    assert counts["false alarms"] == 1
    assert tables["Cost"].rows[0]["with_report"] == 2


@pytest.mark.parametrize(
    ("motion", "aim"), [("designed", "at least 95"), ("ordinary", "at least 85"), ("", None)]
)
def test_aims_are_those_of_the_motion(motion, aim):
    named = scored("single", (LAG,), finding("line_lag", chamber=2))
    named = replace(named, answer=named.answer.model_copy(update={"motion": motion}))
    rows = {row["what"]: row for row in score_tables([named])[0].rows}
    assert rows["identifiable effects named and placed"]["aim_percent"] == aim
    assert rows["trials with a surplus name"]["aim_percent"] == "at most 2"
    assert rows["effects in the set"]["aim_percent"] is None


def test_a_size_counts_as_inside_by_its_own_deviation():
    sure = scored("single", (LAG,), finding("line_lag", value=0.27, std=0.01, chamber=2)).hits[0]
    honest = scored("single", (LAG,), finding("line_lag", value=0.27, std=0.02, chamber=2)).hits[0]
    assert (sure.inside, honest.inside) == (False, True)
    assert abs(sure.size.deviations) > 2.0 > abs(honest.size.deviations)


def test_limits_are_compared_with_what_is_named():
    hit = scored("single", (LAG,), finding("line_lag", chamber=2)).hits[0]
    sizes = [(0.4, False), (1.2, True), (1.9, False), (7.0, True)]
    score_of = scored("single", (LAG,))
    hits = tuple(replace(hit, over_limit=size, named=right) for size, right in sizes)
    rows = limits([replace(score_of, hits=hits)]).rows
    assert [(row["size_over_limit"], row["effects"], row["percent"]) for row in rows] == [
        ("0 to 0.5", 1, 0.0), ("1 to 2", 2, 50.0), ("2 and more", 1, 100.0),
    ]  # fmt: skip


def test_stated_probabilities_are_compared_with_the_truth():
    claims = [scored("single", (LAG,), finding("line_lag", probability=0.92, chamber=2)) for _ in range(3)]
    claims.append(scored("single", (LAG,), finding("line_lag", probability=0.94, chamber=4)))
    (row,) = reliability(claims).rows
    assert (row["names"], row["right_percent"]) == (4, 75.0)
    assert row["mean_stated_percent"] == pytest.approx(92.5)


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
    for (effect, _), counterpart in COUNTERPARTS.items():
        names = {parameter.name for parameter in EFFECTS[effect].parameters}
        # What valves do is reported by a parameter that the library of effects lacks.
        assert set(counterpart.parameters) <= names | {"ceiling"}


def test_the_length_of_a_vector_is_its_size():
    pull = Concealment(effect="external_force", where={"section": "tip"}, size={"force": 0.5})
    found = finding("external_force", section="tip")
    found["parameters"] = {
        "force_x": {"value": 0.3, "std": 0.02}, "force_y": {"value": -0.4, "std": 0.01},
        "force_z": {"value": 0.0, "std": 9.0},
    }  # fmt: skip
    size = scored("single", (pull,), found).hits[0].size
    assert size.stated == pytest.approx(0.5)
    assert size.deviation == pytest.approx(np.hypot(0.6 * 0.02, 0.8 * 0.01))


def test_a_factor_is_one_more_than_a_change():
    stiff = Concealment(effect="segment_stiffness", where={"segment": "upper"}, size={"factor": 0.8})
    found = finding("segment_stiffness", segment="upper")
    found["parameters"] = {"change": {"value": -0.22, "std": 0.02}}
    size = scored("single", (stiff,), found).hits[0].size
    assert (size.true, size.stated) == (pytest.approx(0.2), pytest.approx(0.22))


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
