"""Where searches begin: at a guide's answer."""

import numpy as np
import pytest

from softarm.estimator.inverse import Estimator, LoadProcess, TrackerSettings
from softarm.estimator.model import Inputs
from softarm.estimator.sensing import ActuationMap, Orientation, SensorSuite

GRAVITY = np.array([0.0, 0.0, 9.81])
SIGMA = np.radians(0.1)


def test_a_fresh_search_begins_at_the_answer_of_the_guide(arm) -> None:
    suite = SensorSuite((Orientation("upper", 0, SIGMA), Orientation("lower", 1, SIGMA)))
    pressures = np.array([30e3, 5e3, 12e3, 8e3, 41e3, 20e3])
    truth = Inputs(pressures, np.array([0.12, -0.08, -0.05, 0.1]), GRAVITY)
    state, found = arm.solve(truth, arm.rest())
    assert found
    readings = suite.predict(arm.frames(state))
    settings = TrackerSettings(
        LoadProcess(np.ones(4), 0.0), ActuationMap(np.ones(6), np.zeros(6), 200.0), np.full(6, 65e3)
    )
    alone = Estimator(arm, suite, settings).update(0.0, readings, pressures, GRAVITY)
    guided = Estimator(arm, suite, settings, arm).update(0.0, readings, pressures, GRAVITY)
    assert guided.converged
    assert guided.iterations < alone.iterations
    assert guided.inputs.loads == pytest.approx(alone.inputs.loads, abs=1e-6)
