"""Sensors that stand still are named, and what they read is not believed."""

import re
from dataclasses import replace

import numpy as np
import pytest

from softarm.analysis.diagnosis.workers import Inline
from softarm.estimator.diagnosis.diagnose import assemble
from softarm.estimator.diagnosis.nuisances import calibrate_sessions
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.diagnosis.stuck import (
    MOVING,
    find_stuck,
    stuck_findings,
    without_repeated,
    without_stuck,
)
from softarm.estimator.intake.stuck_pressures import LEAST, stuck_pressures, without_pressures
from softarm.estimator.recording import Recording
from tests.estimator.diagnosis.linear_arm import model, session


def _nominal() -> Session:
    return session("nominal", 0, nominal=True)


@pytest.fixture(scope="module")
def stages() -> tuple[Stage, Stage]:
    """The arm as it is, and with a tip sensor that stops half-way."""
    run = session("run", 11)
    readings = run.readings.copy()
    readings[90:, 2:] = readings[90, 2:]
    fitted = calibrate_sessions(model(), [_nominal()])
    whole, stopped = (fitted.stage(model(), one) for one in (run, replace(run, readings=readings)))
    return whole, stopped


def test_a_sensor_that_moves_is_not_stuck(stages: tuple[Stage, Stage]) -> None:
    assert find_stuck(stages[0]) == ()


def test_a_sensor_that_stops_is_named_with_its_time(stages: tuple[Stage, Stage]) -> None:
    stopped = stages[1]
    stuck = find_stuck(stopped)
    (finding,) = stuck_findings(stuck)
    assert finding.where.sensor == "bend_tip"
    assert finding.parameters["since"].value == pytest.approx(stopped.session.time[90], abs=3.5)
    assert "while the arm moves" in finding.statement
    blind = without_stuck(stopped, stuck)
    time = stopped.session.time - stopped.session.time[0]
    assert np.isnan(blind.session.readings[(time > 22.0) & (time < 42.0), 2:]).all()
    np.testing.assert_array_equal(blind.session.readings[:, :2], stopped.session.readings[:, :2])


def test_a_sensor_that_stops_while_the_arm_moves_slowly_is_stuck(stages: tuple[Stage, Stage]) -> None:
    """It moves by less than counts as motion in the shortest time that counts."""
    run = stages[0].session
    pressures = np.zeros_like(run.pressures)
    pressures[:, 4] = np.interp(run.time - run.time[0], [0.0, 45.0], [0.0, 30e3])
    stage = calibrate_sessions(model(), [_nominal()]).stage(model(), replace(run, pressures=pressures))
    readings = stage.base.copy()
    moved = np.abs(np.diff(readings[:: round(LEAST / run.step), 2:], axis=0)).max()
    readings[90:, 2:] = readings[90, 2:]
    (stuck,) = find_stuck(replace(stage, session=replace(stage.session, readings=readings)))
    assert moved < MOVING
    assert (stuck.sensor, stuck.since) == ("bend_tip", pytest.approx(run.time[90], abs=0.5))


def test_a_sensor_that_stands_still_during_an_event_is_stuck_there_too(stages: tuple[Stage, Stage]) -> None:
    stopped = stages[1]
    session = stopped.session
    during = np.arange(session.samples)[:, None] >= 100
    hidden = replace(
        session,
        readings=np.where(during, np.nan, session.readings),
        event_readings=np.where(during, session.readings, np.nan),
    )
    stuck = find_stuck(replace(stopped, session=hidden))
    assert stuck == find_stuck(stopped)
    left = without_stuck(replace(stopped, session=hidden), stuck).session.event_readings
    assert left is not None
    assert np.isnan(left[115:200, 2:]).all()
    assert np.isfinite(left[115:200, :2]).all()


def test_a_sensor_is_stuck_for_as_long_as_it_reads_the_same_and_the_model_is_elsewhere(
    stages: tuple[Stage, Stage],
) -> None:
    session = stages[0].session
    pressures = session.pressures.copy()
    pressures[120:160] = 0.0
    fitted = calibrate_sessions(model(), [_nominal()])
    still = fitted.stage(model(), replace(session, pressures=pressures))
    readings = still.reading_rows - still.residual
    readings[90:160, 2:] = readings[90, 2:]  # the arm moves at first, and rests away from there for long
    stage = fitted.stage(model(), replace(session, pressures=pressures, readings=readings))
    (stuck,) = find_stuck(stage)
    time = session.time
    assert (stuck.sensor, stuck.until) == ("bend_tip", pytest.approx(time[159], abs=0.5))


def test_a_late_sensor_is_not_stuck(stages: tuple[Stage, Stage]) -> None:
    run = stages[0].session
    settled = np.repeat(np.arange(0, run.samples, 20), 20)[: run.samples]  # poses held for four seconds
    held = replace(run, pressures=run.pressures[settled], gravity=run.gravity[settled])
    stage = calibrate_sessions(model(), [run]).stage(model(), held)
    late = np.roll(stage.base, 1, axis=0)  # a fifth of a second
    assert find_stuck(replace(stage, session=replace(held, readings=late))) == ()


def test_a_calibration_sees_nothing_of_a_sensor_that_repeats_itself() -> None:
    run = session("nominal", 0, nominal=True)
    readings = run.readings.copy()
    readings[:, 2:] = readings[90, 2:]
    stopped = replace(run, readings=readings)
    blind = without_repeated(stopped)
    assert np.isnan(blind.readings[:, 2:]).all()
    np.testing.assert_array_equal(blind.readings[:, :2], run.readings[:, :2])
    at_rest = replace(stopped, pressures=np.tile(run.pressures[:1], (run.samples, 1)))
    np.testing.assert_array_equal(without_repeated(at_rest).readings, readings)
    np.testing.assert_array_equal(without_repeated(run).readings, run.readings)


def test_a_sensor_that_stops_in_a_nominal_recording_moves_no_calibration() -> None:
    runs = [session("nominal", 0, nominal=True), session("other", 2, nominal=True), session("run", 11)]
    readings = runs[0].readings.copy()
    readings[:, 2:] = readings[90, 2:]
    whole, stopped = (
        assemble(model(), sessions, Inline(), ["chamber_gain"])
        for sessions in (runs, [replace(runs[0], readings=readings), *runs[1:]])
    )
    words = r"nominal: bend_tip stands still from .* to .* s; it is left out meanwhile\."
    assert any(re.fullmatch(words, note) for note in stopped.notes)
    assert stopped.stuck == ()
    np.testing.assert_allclose(stopped.evidence.fitted.values, whole.evidence.fitted.values, atol=0.02)


def _valve(given: np.ndarray, asked: np.ndarray) -> Recording:
    return Recording(
        "run", 0.01 * np.arange(len(asked)), {"pressure_cmd_2_pa": asked, "pressure_2_pa": given}
    )


ASKED = np.repeat(np.linspace(0.0, 40e3, 20), 100)


def test_a_pressure_that_follows_or_that_shows_noise_is_not_stuck() -> None:
    noise = np.random.default_rng(0).normal(0.0, 20.0, len(ASKED))
    assert stuck_pressures(_valve(ASKED, ASKED)) == ()
    assert stuck_pressures(_valve(1e4 + noise, ASKED)) == ()
    assert stuck_pressures(_valve(np.full(len(ASKED), 5.0), np.full(len(ASKED), 3e4))) == ()


def test_a_pressure_that_stands_still_is_named_and_its_set_point_stands_in() -> None:
    given = ASKED.copy()
    given[500:1500] = given[500]
    recording = _valve(given, ASKED)
    (stuck,) = stuck_pressures(recording)
    assert (stuck.sensor, stuck.since, stuck.until) == ("pressure_2", 5.0, pytest.approx(15.0, abs=0.02))
    (finding,) = stuck_findings([stuck])
    assert (finding.effect, finding.where.sensor) == ("sensor_stuck", "pressure_2")
    assert "while its set-point moves" in finding.statement
    mended = without_pressures(recording, [stuck], by_set_points=True)
    np.testing.assert_array_equal(mended.columns["pressure_2_pa"], ASKED)
    assert np.isnan(without_pressures(recording, [stuck]).columns["pressure_2_pa"][500:1500]).all()


def test_times_are_those_of_the_recording_wherever_it_begins(stages: tuple[Stage, Stage]) -> None:
    given = ASKED.copy()
    given[500:1500] = given[500]
    recording = replace(_valve(given, ASKED), time=37.6 + 0.01 * np.arange(len(ASKED)))
    (stuck,) = stuck_pressures(recording)
    assert stuck.since == pytest.approx(42.6)
    assert np.isnan(without_pressures(recording, [stuck]).columns["pressure_2_pa"][500:1500]).all()
    session = stages[1].session
    moved = replace(session, clock=session.clock + 137.6, start=session.clock[0] + 100.0)
    stopped = replace(stages[1], session=moved)
    (stuck,) = find_stuck(stopped)
    assert stuck.since == pytest.approx(moved.time[90], abs=3.5)
    assert np.isnan(without_stuck(stopped, (stuck,)).session.readings[110:200, 2:]).all()


def test_a_short_or_unknown_stillness_is_left_alone(stages: tuple[Stage, Stage]) -> None:
    stopped = stages[1]
    short = replace(stopped, session=stopped.session.thin(np.arange(stopped.session.samples) % 60 == 0))
    few = calibrate_sessions(model(), [short.session]).stage(model(), short.session)
    assert find_stuck(few) == ()
    (stuck,) = find_stuck(stopped)
    elsewhere = without_stuck(stopped, (replace(stuck, sensor="bend_other"),))
    np.testing.assert_array_equal(elsewhere.session.readings, stopped.session.readings)
