"""The comparison of the rod with the finite elements beside the estimates, and its finding."""

import os
import threading
from types import SimpleNamespace

import numpy as np
import pytest

from softarm.daemon.estimation.rod_check import LAST, RodCheck
from softarm.daemon.safety.checks import check_rod
from softarm.daemon.safety.observation import EstimatorHealth, RecorderHealth, ServiceHealth, Valves
from softarm.estimator.arm import build_arm
from softarm.estimator.model import Frames, Inputs
from softarm.estimator.rotations import exp
from softarm.estimator.specimen import load_specimen
from softarm_client.modes import Mode


def observation(off: float | None) -> ServiceHealth:
    estimator = EstimatorHealth(running=True, age_s=0.0, deadline_s=1.0, rod_off_degrees=off)
    recorder = RecorderHealth(active=False, dropped=0, error="", free_bytes=10**12)
    return ServiceHealth(Mode.IDLE, Valves("valves", 0.0, 0.1), (), estimator, recorder, 0)


def test_the_departure_of_turned_frames_is_their_angle() -> None:
    model = build_arm(load_specimen("beam"))
    inputs = Inputs(np.zeros(0), np.array([0.02, 0.01]), np.array([-9.81, 0.0, 0.0]))
    state, found = model.solve(inputs, model.rest())
    assert found
    frames = model.section_frames(state)
    turned = Frames(frames.positions, exp(np.array([0.0, 0.01, 0.0])) @ frames.rotations)
    with RodCheck(model, interval_s=10.0) as check:
        assert check.departure is None
        check.offer(0.0, inputs, turned)
        check.wait()
        assert check.departure == pytest.approx(0.01, abs=1e-6)
        check.offer(5.0, inputs, frames)  # too soon
        check.wait()
        assert check.departure == pytest.approx(0.01, abs=1e-6)
        check.offer(10.0, inputs, frames)
        check.wait()
        assert check.departure == pytest.approx(0.0, abs=1e-6)


def test_the_comparison_gives_way_to_the_estimates() -> None:
    ran_at = []

    def solve(*_: object) -> tuple[None, bool]:
        ran_at.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))
        return None, False

    before = os.getpriority(os.PRIO_PROCESS, 0)
    with RodCheck(SimpleNamespace(rest=lambda: None, solve=solve)) as check:  # type: ignore[arg-type]
        check.offer(0.0, Inputs(np.zeros(0), np.zeros(0), np.zeros(3)), Frames(np.zeros(3), np.eye(3)))
        check.wait()
    assert ran_at == [LAST]
    assert os.getpriority(os.PRIO_PROCESS, 0) == before


def test_only_a_rod_that_is_off_is_found() -> None:
    assert list(check_rod(observation(None))) == []
    assert list(check_rod(observation(0.1))) == []
    (finding,) = check_rod(observation(0.8))
    assert finding.severity == "warning"
    assert "0.8 degrees" in finding.message
