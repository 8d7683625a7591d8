"""The three kinds of inverse problem on an arm that is known exactly."""

from dataclasses import fields

import numpy as np
import pytest

from acceptance.forces import forces_problem, independent_prior
from softarm.estimator.inverse import (
    Estimator,
    InputBounds,
    LoadProcess,
    Prior,
    Problem,
    SensorObjective,
    Tolerances,
    TrackerSettings,
    Unknowns,
)
from softarm.estimator.inverse.tracker import RETRIES
from softarm.estimator.model import Inputs
from softarm.estimator.rotations import exp, log
from softarm.estimator.sensing import (
    ActuationMap,
    MarkerPosition,
    MeasuredPose,
    Orientation,
    SensorSuite,
)

RANDOM = np.random.default_rng(11)
GRAVITY = np.array([0.0, 0.0, 9.81])
LIMITS = np.full(6, 65e3)
PRESSURES = np.array([30e3, 5e3, 12e3, 8e3, 41e3, 20e3])
LOADS = np.array([0.12, -0.08, -0.05, 0.1])
SIGMA = np.radians(0.1)


def orientations() -> SensorSuite:
    return SensorSuite((Orientation("upper", 0, SIGMA), Orientation("lower", 1, SIGMA)))


def truth(arm, pressures=PRESSURES, loads=LOADS):
    inputs = Inputs(pressures, loads, GRAVITY)
    state, found = arm.solve(inputs, arm.rest())
    assert found
    return inputs, state


def readings_of(arm, suite, inputs, state):
    return suite.predict(arm.frames(state))


def start(arm, pressures=PRESSURES):
    inputs = Inputs(pressures, np.zeros(len(arm.loads)), GRAVITY)
    return arm.solve(inputs, arm.rest())[0], inputs


def loose_problem(arm, suite, readings, sigma):
    """Ask for the loads at exact pressures, each load with a wide prior."""
    unknowns = Unknowns.of(6, arm.loads)
    prior = independent_prior(unknowns, sigma)
    return forces_problem(unknowns, suite, readings, PRESSURES, None, prior, GRAVITY)


def test_four_forces_from_two_orientations_and_exact_pressures(arm) -> None:
    inputs, state = truth(arm)
    problem = loose_problem(arm, orientations(), readings_of(arm, orientations(), inputs, state), 100.0)
    estimate = problem.solve(arm, start(arm))
    assert estimate.converged
    np.testing.assert_allclose(estimate.inputs.loads, LOADS, atol=1e-6)
    np.testing.assert_allclose(estimate.inputs.pressures, PRESSURES)
    np.testing.assert_allclose(estimate.frames.positions, arm.frames(state).positions, atol=1e-7)
    assert estimate.observability.rank == 4
    assert "6 independent readings, 4 unknowns" in estimate.observability.statement
    assert estimate.observability.statement.endswith("all are determined.")


def test_search_from_far_out_of_balance_needs_no_equilibrium_to_start(arm) -> None:
    inputs, state = truth(arm)
    problem = loose_problem(arm, orientations(), readings_of(arm, orientations(), inputs, state), 100.0)
    estimate = problem.solve(arm, (arm.rest(), Inputs(np.zeros(6), np.zeros(4), GRAVITY)))
    assert estimate.converged
    np.testing.assert_allclose(estimate.inputs.loads, LOADS, atol=1e-6)


def bounded_problem(unknowns: Unknowns, suite: SensorSuite, readings: np.ndarray, prior: Prior) -> Problem:
    """Ask for pressures and loads together, the pressures within their limits."""
    limits = InputBounds.free(unknowns.size).bound(slice(0, unknowns.chambers), 0.0, LIMITS)
    return Problem(unknowns, suite, (SensorObjective(suite, readings), prior), limits, GRAVITY)


def test_six_pressures_and_four_forces_are_too_many_for_two_orientations(arm) -> None:
    inputs, state = truth(arm)
    suite, unknowns = orientations(), Unknowns.of(6, arm.loads)
    information = np.diag(1.0 / np.concatenate([np.full(6, 2e4), np.full(4, 0.5)]) ** 2)
    prior = Prior(np.concatenate([np.full(6, 2e4), np.zeros(4)]), information)
    problem = bounded_problem(unknowns, suite, readings_of(arm, suite, inputs, state), prior)
    estimate = problem.solve(arm, start(arm))
    assert estimate.converged
    assert estimate.observability.rank <= 6
    assert len(estimate.unobservable_directions) == 10 - estimate.observability.rank
    assert (
        f"{10 - estimate.observability.rank} of their combinations cannot be observed"
        in estimate.observability.statement
    )
    assert (estimate.inputs.pressures >= 0.0).all()
    assert (estimate.inputs.pressures <= LIMITS).all()
    for name, residual in estimate.residuals.items():
        assert np.abs(residual).max() < 3 * SIGMA, name


def test_pressures_and_forces_together_where_sensors_suffice(arm) -> None:
    inputs, state = truth(arm)
    suite = SensorSuite(tuple(MeasuredPose(f"pose_{k}", k, 1e-5, 1e-5) for k in range(2)))
    unknowns = Unknowns.of(6, arm.loads)
    weak = Prior(np.full(10, 0.0), np.diag(1.0 / np.concatenate([np.full(6, 1e7), np.full(4, 1e3)]) ** 2))
    problem = bounded_problem(unknowns, suite, readings_of(arm, suite, inputs, state), weak)
    estimate = problem.solve(arm, start(arm, np.full(6, 1e4)))
    assert estimate.converged
    # Torsion and stretch are all but rigid: what two full poses cannot tell must show in the covariance.
    deviation = estimate.vector - np.concatenate([PRESSURES, LOADS])
    free = estimate.observability
    assert free.data_rows == 12
    assert (np.abs(deviation) < 5 * np.sqrt(np.diag(estimate.covariance)) + 1e-3 * unknowns.scale).all()


def test_covariance_of_force_and_pose_is_that_of_repeated_noisy_trials(arm) -> None:
    inputs, state = truth(arm)
    suite, unknowns = orientations(), Unknowns.of(6, arm.loads)
    exact = readings_of(arm, suite, inputs, state)
    rotations = arm.frames(state).rotations
    prior = independent_prior(unknowns, 10.0)
    squares, poses, consistency, begin = [], [], [], start(arm)
    for _ in range(60):
        turned = SensorSuite(
            tuple(
                Orientation(m.name, m.section, SIGMA, SIGMA * RANDOM.normal(size=3))
                for m in suite.measurements
            )
        )
        noisy = turned.predict(arm.frames(state))
        pressures = PRESSURES + 200.0 * RANDOM.normal(size=6)
        problem = forces_problem(unknowns, suite, noisy, pressures, np.full(6, 200.0), prior, GRAVITY)
        estimate = problem.solve(arm, begin, Tolerances(step=1e-4))
        error = estimate.inputs.loads - LOADS
        squares.append(error @ np.linalg.solve(estimate.load_covariance, error))
        tip = log(estimate.frames.rotations[1] @ rotations[1].T)
        poses.append(tip @ np.linalg.solve(estimate.frame_covariance[9:, 9:] + 1e-12 * np.eye(3), tip))
        consistency.append((estimate.normalised_innovation_squared, estimate.degrees_of_freedom))
    assert exact.shape == (8,)
    assert np.mean(squares) == pytest.approx(4.0, abs=4 * np.sqrt(8 / 60))
    assert np.mean(poses) == pytest.approx(3.0, abs=4 * np.sqrt(6 / 60))
    nis, freedom = np.mean(consistency, axis=0)
    assert freedom == pytest.approx(2.0, abs=0.1)
    assert nis == pytest.approx(freedom, abs=4 * np.sqrt(2 * freedom / 60))


def settings(time_constant: float = 1.0) -> TrackerSettings:
    return TrackerSettings(
        LoadProcess(np.full(4, 0.5), time_constant), ActuationMap(np.ones(6), np.zeros(6)), LIMITS
    )


def test_tracker_follows_and_survives_lost_sensors_without_a_jump(arm) -> None:
    suite = SensorSuite(
        (
            Orientation("upper", 0, SIGMA),
            Orientation("lower", 1, SIGMA),
            MarkerPosition("m", 1, 1e-4, np.zeros(3)),
        )
    )
    tracker = Estimator(arm, suite, settings())
    loads, spread = [], []
    inputs, state = truth(arm)
    for step in range(40):
        pressures = PRESSURES * (1 + 0.2 * np.sin(0.1 * step))
        inputs = Inputs(pressures, LOADS, GRAVITY)
        state, _ = arm.solve(inputs, state)
        readings = readings_of(arm, suite, inputs, state)
        if 15 <= step < 30:
            readings[:] = np.nan
        measured = pressures.copy()
        if step == 35:
            measured[2] = np.nan
        estimate = tracker.update(0.01 * step, readings, measured, GRAVITY)
        assert estimate.converged
        loads.append(estimate.inputs.loads)
        spread.append(np.sqrt(np.trace(estimate.load_covariance)))
    forgotten = np.abs(LOADS).max() * (1 - np.exp(-0.16))
    assert np.abs(np.diff(loads, axis=0)[1:]).max() < forgotten
    assert (np.diff(spread[14:30]) > 0).all()
    assert spread[30] < 0.5 * spread[29]
    assert np.linalg.norm(loads[-1] - LOADS) < 0.01
    assert np.linalg.norm(estimate.inputs.pressures - PRESSURES * (1 + 0.2 * np.sin(3.9))) < 1000.0


def test_tracker_starts_afresh_after_nonsense(arm) -> None:
    suite = orientations()
    tracker = Estimator(arm, suite, settings())
    inputs, state = truth(arm)
    good = readings_of(arm, suite, inputs, state)
    tracker.update(0.0, good, PRESSURES, GRAVITY)
    wild = np.concatenate([[0.0, 1.0, 0.0, 0.0], good[4:]])
    tracker.update(0.01, wild, PRESSURES, GRAVITY)
    for k in range(3, 300):
        estimate = tracker.update(0.01 * k, good, PRESSURES, GRAVITY)
    assert estimate.converged
    np.testing.assert_allclose(estimate.inputs.loads, LOADS, atol=5e-3)


@pytest.mark.parametrize(("guided", "retries"), [(False, RETRIES), (True, 0)])
def test_tracker_begins_anew_only_after_several_failures_or_with_a_guide(arm, guided, retries) -> None:
    rests, broken = [], []

    class Watched(type(arm)):
        def rest(self):
            rests.append(True)
            return super().rest()

        def advance(self, step, change):
            return np.nan * super().advance(step, change) if broken else super().advance(step, change)

    suite = orientations()
    watched = Watched(*(getattr(arm, field.name) for field in fields(arm)))
    tracker = Estimator(watched, suite, settings(), arm if guided else None)
    good = readings_of(arm, suite, *truth(arm))
    tracker.update(0.0, good, PRESSURES, GRAVITY)
    rests.clear()
    broken.append(True)
    for failed in range(retries + 1):
        assert tracker.update(0.01 * (failed + 1), good, 0.5 * PRESSURES, GRAVITY).status == "diverged"
        assert not rests
    broken.clear()
    estimate = tracker.update(0.1, good, PRESSURES, GRAVITY)
    assert rests
    assert estimate.converged
    np.testing.assert_allclose(estimate.inputs.loads, LOADS, atol=5e-3)


def test_load_process_forgets_at_its_time_constant() -> None:
    process = LoadProcess(np.array([0.5, 0.2]), 2.0)
    mean, covariance = process.predict(np.array([1.0, 1.0]), np.zeros((2, 2)), 2.0)
    np.testing.assert_allclose(mean, np.exp(-1.0))
    np.testing.assert_allclose(np.diag(covariance), (1 - np.exp(-2.0)) * np.array([0.25, 0.04]))
    halves = process.predict(*process.predict(np.array([1.0, 1.0]), np.zeros((2, 2)), 0.7), 1.3)
    np.testing.assert_allclose(halves[1], covariance)
    np.testing.assert_allclose(process.predict(mean, covariance, 1e3)[1], np.diag([0.25, 0.04]))
    assert LoadProcess(np.ones(1), 0.0).predict(np.ones(1), np.eye(1), 1.0)[0] == 0.0


def test_rotation_about_the_load_axis_is_not_a_direction_that_is_invented(arm) -> None:
    """A force along an axis that the sensors cannot see is left at the prior and said to be."""
    axial = arm.with_loads(
        (*arm.loads, arm.loads[0].__class__("tip_twin", "force", (1.0, 0.0, 0.0), section="tip"))
    )
    suite = orientations()
    inputs = Inputs(PRESSURES, np.concatenate([LOADS, [0.0]]), GRAVITY)
    state, _ = axial.solve(inputs, axial.rest())
    problem = loose_problem(axial, suite, readings_of(axial, suite, inputs, state), 1.0)
    estimate = problem.solve(axial, start(axial))
    assert estimate.unobservable_directions == (
        "1 N of tip_x with -1 N of tip_twin",
    ) or estimate.unobservable_directions == ("1 N of tip_twin with -1 N of tip_x",)
    assert estimate.inputs.loads[2] == pytest.approx(LOADS[2] / 2, abs=1e-2)
    assert exp(np.zeros(3)).shape == (3, 3)
