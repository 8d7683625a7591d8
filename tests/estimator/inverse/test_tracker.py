import time

import numpy as np
import pytest

from softarm.estimator.inverse import Estimator, LoadProcess, Tolerances, TrackerSettings
from softarm.estimator.model import Inputs
from softarm.estimator.sensing import ActuationMap, ModelError, Orientation, SensorSuite
from tests.estimator.inverse.toy_arm import ToyArm

GRAVITY = np.array([0.0, 0.0, 9.81])
SUITE = SensorSuite((Orientation("upper", 0, 2e-3), Orientation("lower", 1, 2e-3)))


def test_pressures_that_are_lost_at_their_bound_leave_a_finite_estimate(arm):
    actuation = ActuationMap(np.ones(6), np.zeros(6))
    settings = TrackerSettings(LoadProcess(np.full(4, 1.0), 1.0), actuation, np.full(6, 65e3))
    follower = Estimator(arm, SUITE, settings)
    inputs = Inputs(np.zeros(6), np.zeros(4), GRAVITY)
    readings = SUITE.predict(arm.frames(arm.solve(inputs, arm.rest())[0]))
    lost = np.full(6, np.nan)
    for _ in range(4):  # at one time, so that nothing has wandered in between
        estimate = follower.update(1.0, readings, lost, GRAVITY)
        assert estimate.converged
        assert np.isfinite(estimate.covariance).all()


@pytest.mark.parametrize("pressure", [1e3, np.nan])
def test_an_instant_that_is_no_number_ends_at_once_and_the_next_goes_on(arm, pressure):
    """ProxQP would iterate on it for half a minute, in which a service takes its estimator for stuck."""
    actuation = ActuationMap(np.ones(6), np.zeros(6))
    settings = TrackerSettings(LoadProcess(np.full(4, 1.0), 1.0), actuation, np.full(6, 65e3))
    follower = Estimator(arm, SUITE, settings)
    inputs = Inputs(np.full(6, 1e3), np.zeros(4), GRAVITY)
    readings = SUITE.predict(arm.frames(arm.solve(inputs, arm.rest())[0]))
    pressures = np.full(6, pressure)
    assert follower.update(1.0, readings, pressures, GRAVITY).converged
    begin = time.process_time()
    assert follower.update(np.nan, readings, pressures, GRAVITY).status == "diverged"
    assert time.process_time() - begin < 1.0
    assert follower.update(1.01, readings, pressures, GRAVITY).converged


def test_the_condition_of_the_arm_widens_the_noise_and_scales_the_forces(arm):
    """The deviation of a force counts what the calibrated model leaves unexplained."""
    pulled = {f"{name}, pressurised pulls": 8e-3 for name in ("upper", "lower")}
    scatter = {"upper": 4e-3, "lower": 4e-3, **pulled}

    def estimate(error, pressure):
        settings = TrackerSettings(
            LoadProcess(np.full(4, 1.0), 0.0),
            ActuationMap(np.ones(6), np.zeros(6)),
            np.full(6, 65e3),
            model_error=error,
        )
        inputs = Inputs(np.full(6, pressure), np.zeros(4), GRAVITY)
        readings = SUITE.predict(arm.frames(arm.solve(inputs, arm.rest())[0]))
        return Estimator(arm, SUITE, settings).update(0.0, readings, inputs.pressures, GRAVITY)

    def deviations(ratios, pressure):
        found = estimate(ModelError.of(scatter, ratios), pressure)
        return np.sqrt(np.diag(found.load_covariance))

    plain = np.sqrt(np.diag(estimate(ModelError(), 0.0).load_covariance))
    vented, pressurised = deviations({}, 0.0), deviations({}, 1e4)
    assert (1.05 * plain < vented).all()
    assert (1.05 * vented < pressurised).all()
    halved = {f"vented pulls on {section}": 0.5 for section in arm.sections}
    np.testing.assert_allclose(deviations(halved, 0.0), 0.5 * vented)
    tip_alone = np.array([1.0, 1.0, 0.5, 0.5])
    np.testing.assert_allclose(deviations({"vented pulls on tip": 0.5}, 0.0), tip_alone * vented)
    np.testing.assert_allclose(deviations(halved, 1e4), pressurised)


def test_a_force_is_known_to_a_share_of_itself_whatever_its_direction(arm):
    def deviation(force):
        settings = TrackerSettings(
            LoadProcess(np.full(4, 10.0), 0.0), ActuationMap(np.ones(6), np.zeros(6)), np.full(6, 65e3),
            model_error=ModelError.of({}, {}, {f"vented pulls on {arm.loads[0].section}": 0.05}),
        )  # fmt: skip
        inputs = Inputs(np.zeros(6), force * np.array([0.6, 0.8, 0.0, 0.0]), GRAVITY)
        readings = SUITE.predict(arm.frames(arm.solve(inputs, arm.rest())[0]))
        estimate = Estimator(arm, SUITE, settings).update(0.0, readings, inputs.pressures, GRAVITY)
        plain = estimate.covariance[6:, 6:]
        return np.sqrt(np.diag(estimate.load_covariance - plain))

    np.testing.assert_allclose(deviation(0.1)[:2], 0.05 * 0.1, rtol=0.05)
    np.testing.assert_allclose(deviation(0.1)[2:], 0.0, atol=1e-7)


class SettledArm(ToyArm):
    """Linearises in equilibrium, as the rod does."""

    def linearise(self, state, inputs):
        return super().linearise(ToyArm(self.loads).solve(inputs, state)[0], inputs)


def followed(arm, pressures, prepares):
    """Follow the pressures of each instant; return the estimates."""
    settings = TrackerSettings(
        LoadProcess(np.ones(4), 0.5), ActuationMap(np.ones(6), np.zeros(6)), np.full(6, 65e3),
        tolerances=Tolerances(step=1e-3),
    )  # fmt: skip
    follower, state, estimates = Estimator(arm, SUITE, settings), arm.rest(), []
    for instant, pressure in enumerate(pressures):
        inputs = Inputs(np.full(6, 1e3) + pressure * np.eye(6)[0], np.array([0.1, 0.0, 0.0, 0.05]), GRAVITY)
        state, _ = arm.solve(inputs, state)
        readings = SUITE.predict(arm.frames(state))
        estimates.append(follower.update(0.01 * instant, readings, inputs.pressures, GRAVITY))
        if prepares:
            follower.prepare()
    return estimates


def test_an_estimate_that_was_prepared_takes_one_step_and_a_jump_takes_more(arm):
    arm = SettledArm(arm.loads)
    pressures = [*np.linspace(1e3, 2e3, 12), 3e4]
    prepared, plain = followed(arm, pressures, prepares=True), followed(arm, pressures, prepares=False)
    assert [estimate.iterations for estimate in prepared[3:12]] == [0] * 9
    assert prepared[12].iterations > 0
    assert min(estimate.iterations for estimate in plain) > 0
    for one, other in zip(prepared, plain, strict=True):
        assert one.converged
        scale = np.array([2e4] * 6 + [0.5] * 4)
        np.testing.assert_allclose(one.vector / scale, other.vector / scale, atol=1e-3)
