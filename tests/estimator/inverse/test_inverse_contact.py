import numpy as np
import pytest

from softarm.estimator.errors import InputError
from softarm.estimator.inverse import ContactSearch, locate_force
from softarm.estimator.model import Inputs, Load
from softarm.estimator.sensing import Orientation, Scene, SectionPose, SensorSuite

GRAVITY = np.array([0.0, 0.0, 9.81])
PRESSURES = np.array([30e3, 5e3, 12e3, 8e3, 41e3, 20e3])
HEIGHTS = np.linspace(0.04, 0.26, 8)
RANDOM = np.random.default_rng(2)


def touched(arm, height, force):
    loads = (
        Load("x", "force", (1.0, 0.0, 0.0), height=height),
        Load("y", "force", (0.0, 1.0, 0.0), height=height),
    )
    model = arm.with_loads(loads)
    inputs = Inputs(PRESSURES, np.asarray(force), GRAVITY)
    return Scene(model.frames(model.solve(inputs, model.rest())[0]), inputs.loads)


def test_a_contact_is_found_with_an_honest_interval(arm) -> None:
    sensors = (SectionPose("upper", 0, 2e-4, 2e-3), SectionPose("lower", 1, 2e-4, 2e-3))
    suite = SensorSuite(sensors)
    scene = touched(arm, 0.193, [0.3, -0.2])
    readings = suite.predict(scene)
    readings[[0, 1, 2, 7, 8, 9]] += 2e-4 * RANDOM.normal(size=6)
    search = ContactSearch(arm.with_loads, suite, np.full(6, 200.0))
    found = locate_force(search, HEIGHTS, readings, PRESSURES, GRAVITY)
    low, high = found.interval
    assert low <= 0.193 <= high
    assert found.located
    assert found.height == pytest.approx(0.193, abs=0.01)
    np.testing.assert_allclose(found.force, [0.3, -0.2], atol=0.03)
    assert "mm from the base" in found.statement


def test_a_faint_contact_is_said_to_be_nowhere_in_particular(arm) -> None:
    suite = SensorSuite((Orientation("upper", 0, 0.02), Orientation("lower", 1, 0.02)))
    readings = suite.predict(touched(arm, 0.15, [0.002, 0.0]))
    search = ContactSearch(arm.with_loads, suite, np.full(6, 200.0))
    found = locate_force(search, HEIGHTS, readings, PRESSURES, GRAVITY)
    assert not found.located
    assert "cannot be placed" in found.statement


def test_too_few_readings_are_refused(arm) -> None:
    suite = SensorSuite((Orientation("lower", 1, 0.02),))
    readings = np.full(4, np.nan)
    with pytest.raises(InputError, match="more sensors"):
        locate_force(ContactSearch(arm.with_loads, suite, None), HEIGHTS, readings, PRESSURES, GRAVITY)
