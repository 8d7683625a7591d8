"""A hand among random poses, in which the intake cannot see it, and what the model leaves of it."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from softarm.analysis.diagnosis.workers import Inline
from softarm.estimator.diagnosis import touches
from softarm.estimator.diagnosis.diagnose import DiagnosisOutcome, diagnose
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.diagnosis.touches import out_of_reach, without_touches
from softarm.estimator.effects import EFFECTS
from softarm.estimator.intake import Disturbance
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.linear_arm import Concealed, model, trial

WEAK = ("chamber_gain", Place(chamber=1), (-0.15,))
BEGIN, SECONDS, RAMP = 19.5, 3.0, 0.4
NOMINAL, QUESTIONED = 1, 3


def touched(session: Session, angle: float) -> Session:
    """Turn the tip by an angle [rad] for some seconds, and what is above it by less."""
    time = session.clock - session.clock[0]
    push = np.clip(np.minimum(time - BEGIN, BEGIN + SECONDS - time) / RAMP, 0.0, 1.0)
    shares = np.array([0.5, 0.0, 1.0, 0.0])
    return replace(session, readings=session.readings + angle * push[:, None] * shares)


def diagnosed(effects: Concealed, *, number: int | None = None, angle: float = 0.15) -> DiagnosisOutcome:
    sessions = trial(effects)
    if number is not None:
        sessions[number] = touched(sessions[number], angle)
    return diagnose(model(), sessions, Inline(), effects=("chamber_gain", "sensor_bias"))


@pytest.mark.parametrize("effects", [[], [WEAK]], ids=["unchanged", "weak chamber"])
@pytest.mark.parametrize("number", [NOMINAL, QUESTIONED], ids=["nominal", "in question"])
def test_a_touch_among_random_poses_is_found_and_decides_nothing(effects: Concealed, number: int) -> None:
    outcome = diagnosed(effects, number=number)
    (touch,) = outcome.touches
    session = trial(effects)[number]
    begin, end = np.array(touch.interval) - session.clock[0]
    assert touch.recording == session.name
    assert BEGIN - 2.0 < begin < BEGIN + 1.0
    assert BEGIN + SECONDS - 1.0 < end < BEGIN + SECONDS + 2.0
    assert touch.size_rad == pytest.approx(0.15, rel=0.3)
    assert touch.usual_rad < 0.02
    without = diagnosed(effects).diagnosis
    assert outcome.diagnosis.verdict == without.verdict
    found, expected = outcome.diagnosis.findings, without.findings
    assert [one.effect for one in found] == [one.effect for one in expected]
    for one, other in zip(found, expected, strict=True):
        for name, quantity in one.parameters.items():
            stated = other.parameters[name]
            assert abs(quantity.value - stated.value) < 2.0 * np.hypot(quantity.std, stated.std)


@pytest.mark.parametrize("effects", [[], [WEAK]], ids=["unchanged", "weak chamber"])
def test_an_arm_that_nobody_touches_has_no_touches(effects: Concealed) -> None:
    assert diagnosed(effects).touches == ()


def test_a_touch_that_moves_no_fit_is_none() -> None:
    assert diagnosed([], number=QUESTIONED, angle=0.02).touches == ()


def test_readings_of_a_touch_are_kept_where_no_fit_sees_them() -> None:
    session = trial([])[QUESTIONED]
    start = float(session.clock[0])
    earlier = np.where(session.clock[:, None] - start < 2.0, session.readings, np.nan)
    session = replace(
        session,
        readings=np.where(np.isfinite(earlier), np.nan, session.readings),
        event_readings=earlier,
    )
    touch = Disturbance(session.name, (start + 19.0, start + 23.0), (), 0.1, 0.0, 0.01, 0.0, 0.99)
    cut = without_touches(
        session, [touch, replace(touch, recording="another", interval=(start, start + 40.0))]
    )
    during = (cut.clock - start >= 19.0) & (cut.clock - start <= 23.0)
    assert np.array_equal(np.isnan(cut.readings).all(axis=1), during | (cut.clock - start < 2.0))
    assert cut.event_readings is not None
    assert np.array_equal(np.isfinite(cut.event_readings), np.isnan(cut.readings))
    assert np.array_equal(cut.with_events.readings, trial([])[QUESTIONED].readings)
    assert without_touches(session, []) is session


@pytest.mark.parametrize(("effect", "hidden"), [("contact_obstacle", True), ("chamber_gain", False)])
def test_where_a_wall_pushes_its_own_error_is_no_touch(
    monkeypatch: pytest.MonkeyPatch, effect: str, hidden: bool
) -> None:
    residual = np.ones((6, 2))
    push = np.zeros((6, 2))
    push[2:4, 1] = np.radians(5.0)
    push[5, 0] = np.radians(1.0)  # too little to matter
    fit: Any = SimpleNamespace(
        hypotheses=(SimpleNamespace(effect=EFFECTS[effect]),), selected=lambda kept: list(kept)
    )
    monkeypatch.setattr(touches, "change_by", lambda _stage, _fit: push)
    stage: Any = SimpleNamespace(
        residual=residual,
        suite=SimpleNamespace(units=("rad", "rad")),
        session=SimpleNamespace(nominal=False),
    )
    left = out_of_reach(stage, fit, residual)
    assert np.array_equal(np.flatnonzero(np.isnan(left).all(axis=1)), [2, 3] if hidden else [])
    assert np.array_equal(out_of_reach(stage, None, residual), residual)
