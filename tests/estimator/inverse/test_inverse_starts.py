"""Where searches begin: at a guide's answer, or where a solve had to end."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from estimator.inverse import (
    Estimator,
    LoadProcess,
    Tolerances,
    TrackerSettings,
    Unknowns,
    independent_prior,
    inputs_problem,
)
from estimator.model import Inputs
from estimator.sensing import ActuationMap, Orientation, Scene, SensorSuite

GRAVITY = np.array([0.0, 0.0, 9.81])
SIGMA = np.radians(0.1)


def test_a_fresh_search_begins_at_the_answer_of_the_guide(arm) -> None:
    suite = SensorSuite((Orientation("upper", 0, SIGMA), Orientation("lower", 1, SIGMA)))
    pressures = np.array([30e3, 5e3, 12e3, 8e3, 41e3, 20e3])
    truth = Inputs(pressures, np.array([0.12, -0.08, -0.05, 0.1]), GRAVITY)
    state, found = arm.solve(truth, arm.rest())
    assert found
    readings = suite.predict(Scene(arm.frames(state), truth.loads))
    settings = TrackerSettings(
        LoadProcess(np.ones(4), 0.0), ActuationMap(np.ones(6), np.zeros(6), 200.0), np.full(6, 65e3)
    )
    alone = Estimator(arm, suite, settings).update(0.0, readings, pressures, GRAVITY)
    guided = Estimator(arm, suite, settings, arm).update(0.0, readings, pressures, GRAVITY)
    assert guided.converged
    assert guided.iterations < alone.iterations
    assert guided.inputs.loads == pytest.approx(alone.inputs.loads, abs=1e-6)


@dataclass(frozen=True)
class Bounded:
    """An arm whose solves end half-way, as one does that may take so much time only."""

    arm: Any
    begun: list[Any] = field(default_factory=list)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.arm, name)

    def solve(self, inputs: Inputs, start: Any) -> tuple[Any, bool]:
        self.begun.append(start)
        share = 0.5 * len(self.begun)
        part = Inputs(share * inputs.pressures, share * inputs.loads, inputs.gravity)
        return self.arm.solve(part, start)[0], share >= 1.0


def test_a_solve_that_ended_half_way_goes_on_at_the_next_instant(arm) -> None:
    suite = SensorSuite((Orientation("upper", 0, SIGMA), Orientation("lower", 1, SIGMA)))
    pressures = np.array([30e3, 5e3, 12e3, 8e3, 41e3, 20e3])
    state, _ = arm.solve(Inputs(pressures, np.zeros(4), GRAVITY), arm.rest())
    readings = suite.predict(Scene(arm.frames(state), np.zeros(4)))
    settings = TrackerSettings(
        LoadProcess(np.ones(4), 0.0),
        ActuationMap(np.ones(6), np.zeros(6), 200.0),
        np.full(6, 65e3),
        tolerances=Tolerances(iterations=1, retreats=0),
    )
    bounded = Bounded(arm)
    estimator = Estimator(bounded, suite, settings)
    for time in (0.0, 0.1):
        estimator.update(time, readings, pressures, GRAVITY)
    assert len(bounded.begun) == 2
    assert bounded.begun[0] is not bounded.begun[1]
    held = arm.solve(Inputs(0.5 * pressures, np.zeros(4), GRAVITY), arm.rest())[0]
    np.testing.assert_allclose(arm.frames(bounded.begun[1]).positions, arm.frames(held).positions, atol=1e-9)


def test_without_retreats_a_search_far_off_ends_without_a_solve(arm) -> None:
    suite = SensorSuite((Orientation("upper", 0, SIGMA), Orientation("lower", 1, SIGMA)))
    pressures = np.array([60e3, 0.0, 0.0, 0.0, 60e3, 0.0])
    state, _ = arm.solve(Inputs(pressures, np.zeros(4), GRAVITY), arm.rest())
    readings = suite.predict(Scene(arm.frames(state), np.zeros(4)))
    unknowns = Unknowns.of(arm.chambers, arm.loads)
    prior = independent_prior(unknowns, 1.0)
    problem = inputs_problem(unknowns, suite, readings, np.full(6, 65e3), prior, GRAVITY)
    none = Inputs(np.zeros(6), np.zeros(4), GRAVITY)
    bounded = Bounded(arm)
    found = problem.solve(bounded, (arm.rest(), none), Tolerances(iterations=25, retreats=0, radius=50.0))
    assert found.status != "diverged"
    assert not bounded.begun
    assert np.isfinite(found.vector).all()
