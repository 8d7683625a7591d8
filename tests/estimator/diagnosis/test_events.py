"""Stretches that look like a touch before the physics is known, and what the diagnosed model says of them."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from softarm.analysis.diagnosis.workers import Inline
from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis import events
from softarm.estimator.diagnosis.diagnose import diagnose
from softarm.estimator.diagnosis.events import EventErrors, change_of_sensors, law_errors
from softarm.estimator.diagnosis.fit import Fit
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.diagnosis.prepare import averaged, prepare
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.effects import EFFECTS
from softarm.estimator.intake import Disturbance, Intake
from softarm.estimator.intake.unsteady import LEAST
from softarm.estimator.recording import Recording
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.linear_arm import model, trial
from tests.estimator.diagnosis.test_prepare import SECTIONS, SOPRA, _recording

WEAK = ("chamber_gain", Place(chamber=1), (-0.15,))
BEGIN, END = 20.0, 26.0


def eventful(session: Session, touch: float) -> Session:
    """Hide a stretch of a session from fits, in which something turns the tip by an angle [rad]."""
    time = session.clock - session.clock[0]
    during = ((time >= BEGIN) & (time <= END))[:, None]
    touched = session.readings + np.where(during, touch, 0.0)
    return replace(
        session,
        readings=np.where(during, np.nan, session.readings),
        event_readings=np.where(during, touched, np.nan),
    )


@pytest.mark.parametrize(("touch", "explained"), [(0.0, True), (np.radians(12.0), False)])
def test_what_the_findings_cause_is_no_event_and_a_touch_stays_one(touch: float, explained: bool) -> None:
    sessions = trial([WEAK])
    sessions[3] = eventful(sessions[3], touch)
    outcome = diagnose(model(), sessions, Inline(), effects=("chamber_gain", "sensor_bias"))
    assert [finding.effect for finding in outcome.diagnosis.findings] == ["chamber_gain"]
    (errors,) = outcome.event_errors
    assert errors.recording == "run_1"
    start = float(sessions[3].clock[0])
    left = errors.explained((start + BEGIN, start + END))
    assert (left is not None) is explained
    if left is not None:
        assert left["rad"] < LEAST["rad"]
    assert errors.explained((start, start + 5.0)) is None  # fits may see every reading there


def test_an_error_is_measured_by_what_the_intake_would_have_reported() -> None:
    clock = np.arange(40.0)
    errors = np.full((40, 2), np.nan)
    errors[10:20] = 0.9 * np.array([LEAST["m"], LEAST["rad"]])
    still = np.zeros_like(errors)
    model_errors = EventErrors("run", clock, errors, clock >= 0.0, still, np.zeros(2), ("m", "rad"))
    assert model_errors.explained((10.0, 19.0)) == pytest.approx(
        {"m": 0.9 * LEAST["m"], "rad": 0.9 * LEAST["rad"]}
    )
    assert model_errors.explained((50.0, 60.0)) is None  # no sample lies there
    larger = replace(model_errors, errors=1.2 * errors)
    assert larger.explained((10.0, 19.0)) is None
    swinging = replace(larger, allowed=still + 0.3 * np.array([LEAST["m"], LEAST["rad"]]))
    assert swinging.explained((10.0, 19.0)) == pytest.approx(
        {"m": 1.08 * LEAST["m"], "rad": 1.08 * LEAST["rad"]}
    )
    assert replace(larger, ranges=np.array([1.0, 1.0])).explained((10.0, 19.0)) is not None
    stuck = errors.copy()
    stuck[10:14, 1], stuck[14:, 1] = 1.0, np.nan
    assert replace(model_errors, errors=stuck).explained((10.0, 19.0)) == pytest.approx(
        {"m": 0.9 * LEAST["m"]}
    )
    stuck[14, 1] = 1.0
    assert replace(model_errors, errors=stuck).explained((10.0, 19.0)) is None


def test_what_a_law_gets_wrong_may_point_to_any_side_of_the_sensor_that_it_moves() -> None:
    session = trial([WEAK])[3]
    rows = session.suite.slices[session.suite.measurements[0].name]
    assert set(session.suite.units[rows]) == {"rad"}
    change = np.zeros((2, len(session.suite.units)))
    change[1, rows.start : rows.start + 2] = 0.3, -0.4
    sizes = change_of_sensors(change, session.suite)
    assert sizes[1, rows] == pytest.approx(0.5)
    sizes[1, rows] = 0.0
    assert not sizes.any()


def test_the_law_of_a_finding_may_get_some_of_what_it_changes_wrong() -> None:
    """A law leaves three tenths of what it changes: 95 % of such errors are within 1.96 of them."""

    def allowed(sessions: list[Session]) -> Floats:
        sessions[3] = eventful(sessions[3], 0.0)
        outcome = diagnose(model(), sessions, Inline(), effects=("chamber_gain",))
        return outcome.event_errors[0].allowed[:, :2]

    usual, weak = trial([]), trial([WEAK])
    changed = np.linalg.norm((weak[3].readings - usual[3].readings)[:, :2], axis=1, keepdims=True)
    by_law = np.sqrt(np.maximum(allowed(weak) ** 2 - allowed(usual) ** 2, 0.0))
    large = changed[:, 0] > 0.5 * changed.max()
    assert by_law[large] / changed[large] == pytest.approx(1.96 * 0.3, rel=0.1)


def test_an_arm_may_be_as_far_away_as_a_law_that_is_a_little_stronger_puts_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One that is about to snap through is far from where its law has it if that is wrong by little."""
    suite = trial([WEAK])[3].suite
    fit = Fit((Hypothesis(EFFECTS["tip_payload"], Place()),), (np.array([0.02]),), np.eye(1), 0.0)

    def change(_: object, own: Fit) -> Floats:
        return np.tile((own.thetas[0][0] / 0.02) ** 8 * np.ones(len(suite.units)), (2, 1))

    monkeypatch.setattr(events, "change_by", change)
    stage = cast("Any", SimpleNamespace(suite=suite))
    rows = suite.slices[suite.measurements[0].name]
    errors = law_errors(stage, fit, change(stage, fit))
    assert errors[:, rows] == pytest.approx((1.3**8 - 1.0) * np.sqrt(2.0))


def test_amplitudes_grow_within_their_bounds_and_shapes_stay() -> None:
    leak = Hypothesis(EFFECTS["line_leak"], Place(chamber=1))
    fit = Fit((leak,), (np.array([0.9, 0.3, 7.0]),), np.eye(3), 0.0)
    assert fit.with_amplitudes(1.3).thetas[0] == pytest.approx([0.95, 0.39, 7.0])


def test_readings_during_an_event_stay_beside_those_that_fits_see() -> None:
    recording = _recording()
    event = Disturbance("run", (10.0, 14.0), ("frame_tip",), 0.1, 0.0, 0.01, 0.0, 0.99)
    intake = Intake(recording, events=(event,), excluded=((10.0, 14.0), (13.0, 20.0)))
    seen = intake.with_events(intake.for_fits)
    height = seen.columns["frame_tip_z_m"]
    shown = (recording.time <= 20.0) & (recording.time >= 13.0)
    assert np.array_equal(np.isnan(height), shown)  # what another reason excludes stays lost
    session = averaged(prepare(seen, SOPRA, SECTIONS, nominal=False, events=[event.interval]).session, 0.1)
    assert session.event_readings is not None
    during = (session.clock > 10.05) & (session.clock < 12.9)
    assert np.isnan(session.readings[during]).all()
    assert np.isfinite(session.event_readings[during]).all()
    assert np.isnan(session.event_readings[(session.clock < 9.95) | (session.clock > 14.05)]).all()
    kept = session.thin(during)
    assert kept.event_readings is not None
    assert len(kept.event_readings) == during.sum()


def test_the_session_clock_goes_on_between_recordings() -> None:
    assert Recording("run", np.arange(3.0), {}, {"session_start_s": 12.5}).start == 12.5
    assert Recording("run", np.arange(3.0), {}).start == 0.0
