import re

import numpy as np
import pytest

from acceptance.forces import forces_problem, independent_prior
from softarm.estimator.inverse import (
    Tolerances,
    Unknowns,
    approach,
    replace_loads,
    settle,
)
from softarm.estimator.model import Inputs
from softarm.estimator.sensing import Orientation, SensorSuite

GRAVITY = np.array([0.0, 0.0, 9.81])
PRESSURES = np.array([20e3, 12e3, 16e3, 18e3, 21e3, 15e3])
LIMITS = np.full(6, 65e3)
NONE = np.zeros(4)
SUITE = SensorSuite((Orientation("upper", 0, 2e-3), Orientation("lower", 1, 2e-3)))


def frames(arm, pressures, loads):
    inputs = Inputs(pressures, np.asarray(loads), GRAVITY)
    return arm.frames(arm.solve(inputs, arm.rest())[0])


def estimated(arm, loads, pressures=PRESSURES):
    readings = SUITE.predict(frames(arm, pressures, loads))
    unknowns = Unknowns.of(arm.chambers, arm.loads)
    prior = independent_prior(unknowns, 5.0)
    problem = forces_problem(unknowns, SUITE, readings, pressures, np.full(6, 100.0), prior, GRAVITY)
    inputs = Inputs(pressures, NONE, GRAVITY)
    return problem.solve(arm, (arm.solve(inputs, arm.rest())[0], inputs))


def angles(one, other):
    turns = np.einsum("sij,skj->sik", one.rotations, other.rotations)
    return np.arccos(np.clip((np.trace(turns, axis1=1, axis2=2) - 1.0) / 2.0, -1.0, 1.0))


def tilts(one, other):
    """Angles between the sections' axes: no pressure makes a twist about them."""
    along = np.einsum("si,si->s", one.rotations[:, :, 2], other.rotations[:, :, 2])
    return np.arccos(np.clip(along, -1.0, 1.0))


@pytest.mark.parametrize("loads", [(0.0, 0.0, 0.03, -0.02), (0.05, 0.02, -0.03, 0.01)])
def test_pressures_hold_the_pose_that_a_hand_held(arm, loads):
    held = replace_loads(estimated(arm, loads), SUITE, LIMITS, NONE)
    assert np.abs(held.change).max() < 30e3
    pose = frames(arm, PRESSURES, loads)
    without = tilts(pose, frames(arm, PRESSURES, NONE)).max()
    left = tilts(pose, frames(arm, PRESSURES + held.change, NONE)).max()
    assert without > 0.05
    assert left < 0.15 * without  # the rest is left to the feedback


@pytest.mark.parametrize("loads", [(0.0, 0.0, 0.03, -0.02), (0.05, 0.02, -0.03, 0.01)])
def test_the_search_from_there_comes_nearer_and_goes_on_from_its_end(arm, loads):
    estimate = estimated(arm, loads)
    first = replace_loads(estimate, SUITE, LIMITS, NONE)
    held, found = settle(arm, estimate, SUITE, LIMITS, NONE, first)
    assert found is not None
    np.testing.assert_array_equal(found.inputs.loads, NONE)
    pose = frames(arm, PRESSURES, loads)
    misses = [tilts(pose, frames(arm, PRESSURES + c.change, NONE)).max() for c in (first, held)]
    assert misses[1] <= misses[0]


def test_a_search_that_fails_leaves_the_first_answer(arm):
    estimate = estimated(arm, (0.0, 0.0, 0.03, -0.02))
    first = replace_loads(estimate, SUITE, LIMITS, NONE)
    held, found = settle(arm, estimate, SUITE, LIMITS, NONE, first, Tolerances(0.0, 0.0, iterations=1))
    assert held is first
    assert found is None


def test_what_the_tare_took_as_zero_is_not_held(arm):
    loads = np.array([0.0, 0.0, 0.03, -0.02])
    estimate = estimated(arm, loads)
    held = replace_loads(estimate, SUITE, LIMITS, estimate.inputs.loads)
    np.testing.assert_allclose(held.change, 0.0, atol=1.0)


def test_feedback_leads_to_the_target(arm):
    pressures, target = PRESSURES.copy(), frames(arm, PRESSURES + 1e3 * np.arange(-3, 3), NONE)
    for _ in range(4):
        estimate = estimated(arm, NONE, pressures)
        np.testing.assert_allclose(estimate.measured_pressures, pressures)
        pressures = pressures + approach(estimate, SUITE, LIMITS, target, pressures).change
    assert angles(target, frames(arm, pressures, NONE)).max() < 1e-3


def test_feedback_takes_nothing_from_a_vented_chamber_that_the_estimate_sees_filled(arm):
    estimate = estimated(arm, NONE)
    target = frames(arm, PRESSURES - np.array([3e3, 0.0, 0.0, 0.0, 0.0, 0.0]), NONE)
    free = approach(estimate, SUITE, LIMITS, target, PRESSURES)
    bound = approach(estimate, SUITE, LIMITS, target, np.array([0.0, 12e3, 16e3, 18e3, 21e3, 15e3]))
    assert free.change[0] < -1e3
    assert bound.change[0] > -1.0
    assert bound.change[1:3].sum() > free.change[1:3].sum() + 500.0  # the chambers beside it do it instead


def test_feedback_leads_the_readings_back_not_the_estimate(arm):
    estimate = estimated(arm, NONE)
    here = estimate.frames
    at_rest = approach(estimate, SUITE, LIMITS, here, PRESSURES, estimate.residuals)
    np.testing.assert_allclose(at_rest.change, 0.0, atol=1.0)
    there = {name: residual + np.array([0.01, 0.0, 0.0]) for name, residual in estimate.residuals.items()}
    led = approach(estimate, SUITE, LIMITS, here, PRESSURES, there)
    twists = SUITE.sensitivity(here, SUITE.predict(here)).twists
    moved = twists @ estimate.motion[:, :6] @ led.change
    np.testing.assert_allclose(moved[[0, 3]], 0.01, atol=1e-3)


def test_pose_out_of_reach_says_what_limits_it(arm):
    held = replace_loads(estimated(arm, (0.0, 0.0, 0.3, 0.1)), SUITE, 0.5 * LIMITS, NONE)
    assert not held.reachable
    assert re.search(r"cannot be reached: (upper|lower) misses by [\d.]+ degrees \(", held.statement)
    assert "chamber" in held.statement
    assert np.all(PRESSURES + held.change <= 0.5 * LIMITS + 1.0)
    assert np.all(PRESSURES + held.change >= -1.0)
