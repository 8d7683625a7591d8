"""A fast model answers while the search on an exact one has lost the arm."""

from dataclasses import fields
from threading import Event, current_thread, main_thread

import numpy as np
import pytest

from softarm.estimator.inverse import (
    BackgroundSolver,
    Estimator,
    FallbackEstimator,
    LoadProcess,
    Tolerances,
    TrackerSettings,
)
from softarm.estimator.model import Inputs
from softarm.estimator.sensing import ActuationMap, Orientation, SensorSuite

GRAVITY = np.array([0.0, 0.0, 9.81])
LIMITS = np.full(6, 65e3)
NEAR, FAR = np.full(6, 10e3), np.array([60e3, 0.0, 0.0, 60e3, 0.0, 0.0])
LOADS = np.array([0.12, -0.08, -0.05, 0.1])
SUITE = SensorSuite((Orientation("upper", 0, 1e-3), Orientation("lower", 1, 1e-3)))
SETTINGS = TrackerSettings(
    LoadProcess(np.ones(4), 0.0),
    ActuationMap(np.ones(6), np.zeros(6), 200.0),
    LIMITS,
    tolerances=Tolerances(solves_after_rejection=False),
)
REACH = 0.3


@pytest.fixture
def followed(arm):
    """Make an estimator, events that break its search and let its model be solved, and whose threads did."""
    broken, solved_in, allowed = Event(), [], Event()

    class Exact(type(arm)):
        def advance(self, step, change):
            breaks = broken.is_set() and current_thread() is main_thread()
            return super().advance(step, change) * (np.nan if breaks else 1.0)

        def solve(self, inputs, start):
            solved_in.append(current_thread())
            allowed.wait()
            return super().solve(inputs, start)

    exact = Exact(*(getattr(arm, field.name) for field in fields(arm)))
    with BackgroundSolver(exact, REACH) as background:
        allowed.set()
        estimator = FallbackEstimator(
            Estimator(exact, SUITE, SETTINGS), Estimator(arm, SUITE, SETTINGS), background
        )
        yield estimator, background, broken, solved_in, allowed
        allowed.set()


def instant(arm, estimator, time, pressures):
    state, found = arm.solve(Inputs(pressures, LOADS, GRAVITY), arm.rest())
    assert found
    return estimator.update(time, SUITE.predict(arm.frames(state)), pressures, GRAVITY)


def test_an_arm_that_was_lost_is_answered_for_at_once_and_found_again(arm, followed) -> None:
    estimator, background, broken, solved_in, _ = followed
    lost = []
    for number in range(12):
        (broken.set if number == 5 else broken.clear)()
        estimate = instant(arm, estimator, 0.15 * number, (1.0 + 0.01 * number) * NEAR)
        assert estimate.converged
        np.testing.assert_allclose(estimate.inputs.loads, LOADS, atol=5e-3)
        lost.append(estimator.lost)
        background.wait()
    assert [number for number, flag in enumerate(lost) if flag] == [0, 1, 5, 6]
    assert solved_in
    assert main_thread() not in solved_in


def test_the_exact_model_waits_until_a_step_reaches_the_arm(arm, followed) -> None:
    estimator, background, _, _, allowed = followed
    allowed.clear()
    for number in range(2):
        instant(arm, estimator, 0.15 * number, NEAR)
    assert not background.idle
    assert instant(arm, estimator, 0.3, FAR).converged
    allowed.set()
    background.wait()
    lost = []
    for number in range(3, 6):
        assert instant(arm, estimator, 0.15 * number, FAR).converged
        lost.append(estimator.lost)
        background.wait()
    assert lost == [True, False, False]


def test_the_exact_model_is_not_brought_to_where_the_arm_passes_by(arm, followed) -> None:
    estimator, background, _, solved_in, _ = followed
    for number in range(8):
        instant(arm, estimator, 0.15 * number, FAR if number % 2 else NEAR)
        background.wait()
    assert not solved_in


def test_a_reset_forgets_both_estimates(arm, followed) -> None:
    estimator, background, *_ = followed
    for number in range(3):
        instant(arm, estimator, 0.15 * number, NEAR)
        background.wait()
    assert not estimator.lost
    estimator.reset()
    assert instant(arm, estimator, 0.0, FAR).converged
    assert estimator.lost
