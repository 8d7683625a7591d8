import numpy as np

from softarm.estimator.inverse import Estimator, LoadProcess, TrackerSettings
from softarm.estimator.model import Inputs
from softarm.estimator.sensing import ActuationMap, Orientation, Scene, SensorSuite

GRAVITY = np.array([0.0, 0.0, 9.81])
SUITE = SensorSuite((Orientation("upper", 0, 2e-3), Orientation("lower", 1, 2e-3)))


def test_pressures_that_are_lost_at_their_bound_leave_a_finite_estimate(arm):
    actuation = ActuationMap.identity(6)
    settings = TrackerSettings(LoadProcess(np.full(4, 1.0), 1.0), actuation, np.full(6, 65e3))
    follower = Estimator(arm, SUITE, settings)
    inputs = Inputs(np.zeros(6), np.zeros(4), GRAVITY)
    readings = SUITE.predict(Scene(arm.frames(arm.solve(inputs, arm.rest())[0]), inputs.loads))
    lost = np.full(6, np.nan)
    for _ in range(4):  # at one time, so that nothing has wandered in between
        estimate = follower.update(1.0, readings, lost, GRAVITY)
        assert estimate.converged
        assert np.isfinite(estimate.covariance).all()
