"""Constants of the choice are found with their source, and moved wherever they are used."""

from typing import Any, cast

import numpy as np
import pytest

from acceptance.proof import sensitivity
from acceptance.proof.sensitivity import (
    CHOICE,
    OF_THE_VALVES,
    STEP,
    DecidingConstant,
    deciding_constants,
    moved,
    of_valves,
    sensitivity_table,
)
from softarm.bench.trials.folders import Trial
from softarm.estimator.diagnosis import (
    candidates,
    choose,
    confirm,
    judge,
    nominal,
    unnamed,
    valve_stage,
)
from softarm.estimator.recording import Recording


def constant(module: str, name: str) -> DecidingConstant:
    return next(one for one in deciding_constants() if (one.module, one.name) == (module, name))


def test_constants_are_listed_with_value_and_source():
    assert constant("diagnose", "CHANGED").value == 20.0
    assert "Kass and Raftery" in constant("diagnose", "CHANGED").source
    assert constant("candidates", "ALIKE").source == constant("candidates", "ALIKE_SHARE").source
    assert constant("probability", "CREDIBLE").value == 0.95
    assert len(deciding_constants()) > 40


def test_a_constant_moves_wherever_it_was_imported_and_comes_back():
    before = judge.CERTAIN
    with moved(constant("judge", "CERTAIN"), 1.0 + STEP):
        assert judge.CERTAIN == choose.CERTAIN == unnamed.CERTAIN == pytest.approx(1.2 * before)
    assert judge.CERTAIN == choose.CERTAIN == unnamed.CERTAIN == before


def test_constants_of_one_name_move_apart():
    with moved(constant("nominal", "MATERIAL"), 1.0 + STEP):
        assert pytest.approx(1.2 * judge.MATERIAL) == nominal.MATERIAL


def test_a_constant_of_another_module_with_the_same_name_stays():
    shared = {one.name for one in deciding_constants()} & {
        name for name in vars(valve_stage) if name.isupper()
    }
    assert shared
    before = {name: getattr(valve_stage, name) for name in shared}
    for one in deciding_constants():
        if one.name in shared:
            with moved(one, 1.0 + STEP):
                assert {name: getattr(valve_stage, name) for name in shared} == before
    assert {name: getattr(valve_stage, name) for name in shared} == before


def test_what_a_module_has_imported_from_elsewhere_under_the_same_name_stays():
    before = unnamed.NOTHING
    with moved(constant("confirm", "NOTHING"), 1.0 + STEP):
        assert unnamed.NOTHING is before
    assert unnamed.NOTHING is before


def test_whole_numbers_move_by_one_at_least():
    with moved(constant("choose", "MOST"), 1.0 - STEP):
        assert choose.MOST == 3


def rows_that_change(monkeypatch, folder, verdict):
    """Rows of the table of one trial whose verdict is a function of the constants."""
    monkeypatch.setattr(sensitivity, "products_of_trial", lambda *_: None)
    monkeypatch.setattr(sensitivity, "remembering", lambda _: object())
    monkeypatch.setattr(sensitivity, "_fresh", lambda search: search)
    monkeypatch.setattr(sensitivity, "verdict_of", lambda _: (verdict(),))
    table = sensitivity_table(CHOICE, [Trial("one", "sopra", (), ())], folder, lambda _: None)
    return [row for row in table.rows if row["changes"]]


def test_a_constant_that_decides_is_shown_with_what_it_changes(monkeypatch, tmp_path):
    changing = rows_that_change(
        monkeypatch, tmp_path, lambda: "explained" if candidates.SIGNIFICANT_Z <= 3.0 else "consistent"
    )
    assert [row["constant"] for row in changing] == ["candidates.SIGNIFICANT_Z"]
    assert changing[0]["which"] == "one x 1.2: consistent"


def test_changes_count_for_the_constant_of_one_module_alone(monkeypatch, tmp_path):
    changing = rows_that_change(
        monkeypatch, tmp_path, lambda: "explained" if confirm.SURE <= 10.0 else "consistent"
    )
    assert [row["constant"] for row in changing] == ["confirm.SURE"]


def test_constants_of_valves_are_moved_on_the_recordings_themselves(monkeypatch, tmp_path):
    """A valve 350 Pa low is named, and is not where 360 Pa are the least."""
    time = np.arange(0.0, 80.0, 0.01)
    asked = np.repeat([0.0, 20e3, 30e3, 40e3, 0.0, 25e3, 15e3, 0.0], len(time) // 8)
    given = np.where(asked > 0.0, asked - 350.0, 0.0) + np.random.default_rng(1).normal(0.0, 30.0, len(time))
    recording = Recording("low", time, {"pressure_cmd_0_pa": asked, "pressure_0_pa": given})
    monkeypatch.setattr(sensitivity, "load_recording", lambda _: recording)
    verdict = of_valves(Trial("one", "sopra", (), (tmp_path,)), tmp_path)
    assert verdict(None) == ("pressure_bias (chamber 0)",)
    least = next(one for one in deciding_constants(OF_THE_VALVES) if one.name == "LEAST_BIAS")
    with moved(least, 1.0 + STEP):
        assert verdict(least) == ()


def test_a_run_that_was_ended_goes_on_from_its_verdicts(monkeypatch, tmp_path):
    done = []
    rows_that_change(monkeypatch, tmp_path, lambda: done.append(1) or "consistent")
    first = len(done)
    changing = rows_that_change(monkeypatch, tmp_path, lambda: done.append(1) or "consistent")
    assert first == 1 + 2 * len(deciding_constants())
    assert len(done) == first + 1
    assert not changing


def test_a_search_that_starts_anew_keeps_fits_but_no_predictions():
    """A moved constant may change how folds are predicted."""
    rng = np.random.default_rng(1)
    search = sensitivity.RememberingSearch(
        cast("Any", None), cast("Any", None), cast("Any", None), rng, tried={(0,): None}
    )
    search.predictions["of", "before"] = cast("Any", None)
    fresh = sensitivity._fresh(search)
    assert fresh.predictions == {}
    assert fresh.tried is search.tried
    assert fresh.joint is search.joint
