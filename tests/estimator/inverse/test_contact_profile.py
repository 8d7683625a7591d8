import numpy as np
import pytest

from acceptance.forces import forces_problem, independent_prior
from softarm.estimator.inverse import ContactProfile, Unknowns
from softarm.estimator.model import Inputs, Load
from softarm.estimator.sensing import MeasuredPose, Orientation, SensorSuite

GRAVITY = np.array([0.0, 0.0, 9.81])
PRESSURES = np.array([30e3, 5e3, 12e3, 8e3, 41e3, 20e3])
SIGMA = np.full(6, 200.0)
PROFILE = ContactProfile(np.linspace(0.04, 0.27, 10), form_share=0.0)
POSES = SensorSuite((MeasuredPose("upper", 0, 2e-4, 2e-3), MeasuredPose("lower", 1, 2e-4, 2e-3)))


def touched(arm, height, force, suite):
    loads = tuple(
        Load(name, "force", axis, height=height)
        for name, axis in {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}.items()
    )
    model = arm.with_loads(loads)
    inputs = Inputs(PRESSURES, np.asarray(force), GRAVITY)
    return suite.predict(model.frames(model.solve(inputs, model.rest())[0]))


def place(arm, suite, readings, profile=PROFILE):
    unknowns = Unknowns.of(arm.chambers, arm.loads)
    prior = independent_prior(unknowns, 1.0)
    problem = forces_problem(unknowns, suite, readings, PRESSURES, SIGMA, prior, GRAVITY)
    inputs = Inputs(PRESSURES, np.zeros(4), GRAVITY)
    estimate = problem.solve(arm, (arm.solve(inputs, arm.rest())[0], inputs))
    pushed = arm.with_loads((*arm.loads, *profile.loads))
    return profile.place(pushed, estimate.state, suite, readings, estimate, np.zeros(4))


@pytest.mark.parametrize("height", [0.15, 0.2, 0.25])
@pytest.mark.parametrize("force", [(0.2, -0.1), (-0.1, 0.05)])
def test_a_push_is_placed_within_what_it_says(arm, height, force):
    readings = touched(arm, height, force, POSES)
    found = place(arm, POSES, readings)
    assert found.located
    assert found.height == pytest.approx(height, abs=0.008)  # the toy bends in four joints only
    assert found.deviation < 0.02
    np.testing.assert_allclose(found.force, force, atol=0.02)


@pytest.mark.parametrize("height", [0.15, 0.2])
@pytest.mark.parametrize("share", [-0.05, 0.05])
def test_an_arm_that_shears_unlike_the_model_is_placed_within_what_it_says(arm, height, share):
    profile = ContactProfile(PROFILE.heights)
    rest, pushed = (touched(arm, height, force, POSES) for force in ((0.0, 0.0), (0.2, -0.1)))
    positions = np.isin(np.arange(len(rest)) % 7, range(3))
    pushed[positions] += share * (pushed - rest)[positions]
    found = place(arm, POSES, pushed, profile)
    assert abs(found.height - height) < 2.0 * found.deviation
    assert found.deviation < 0.01


def test_a_faint_push_is_not_placed(arm):
    assert not place(arm, POSES, touched(arm, 0.15, (0.002, 0.0), POSES)).located


def test_fewer_than_six_measurements_place_nothing(arm):
    suite = SensorSuite((Orientation("lower", 1, 0.02),))
    assert place(arm, suite, touched(arm, 0.15, (0.2, 0.0), suite)) is None
