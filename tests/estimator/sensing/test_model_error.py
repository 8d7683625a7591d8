"""What a calibration leaves unexplained: sorted by condition, and added to the sensors' own noise."""

import numpy as np
import pytest

from softarm.estimator.model import Load
from softarm.estimator.sensing import (
    Bend,
    MeasuredPose,
    Measurement,
    ModelError,
    Orientation,
    SensorSuite,
    widened,
)
from softarm.estimator.sensing.model_error import UNPULLED_ERROR

SCATTER = {
    "bend_tip": 0.02,
    "bend_tip, vented pulls": 0.005,
    "bend_tip, pressurised pulls": 0.01,
    "frame_tip position": 3e-3,
    "frame_tip rotation": 0.04,
}


@pytest.mark.parametrize(
    ("pressure", "bend", "ratio"), [(0.0, 0.005, 0.7), (np.nan, 0.005, 0.7), (5e3, 0.01, 1.0)]
)
def test_pressures_tell_the_condition(pressure: float, bend: float, ratio: float) -> None:
    error = ModelError.of(SCATTER, {"vented pulls on tip": 0.7})
    condition = error.at(np.array([0.0, pressure]))
    assert condition.scatter["bend_tip"] == bend
    assert condition.scatter["frame_tip rotation"] == 0.04  # not measured while anybody pulled
    assert condition.force_ratio("tip") == ratio


def test_a_section_that_nobody_pulled_is_not_known_better_than_its_readings() -> None:
    error = ModelError.of({}, {"vented pulls on tip": 0.7, "pressurised pulls on tip": 1.5})
    assert error.vented.force_ratio("intermediate") == 1.0
    assert error.pressurised.force_ratio("intermediate") == 1.5
    assert ModelError().vented.force_ratio(None) == 1.0


def test_the_error_that_grows_with_a_force_is_that_of_the_condition() -> None:
    error = ModelError.of({}, {}, {"vented pulls on tip": 0.007, "pressurised pulls on tip": 0.012})
    assert error.vented.relative_error("tip") == 0.007
    assert error.pressurised.relative_error("tip") == 0.012
    assert error.vented.relative_error("intermediate") == UNPULLED_ERROR


@pytest.mark.parametrize(("ratio", "expected"), [(0.7, 1.0), (1.5, 1.5)])
def test_pulls_across_the_arm_do_not_make_other_loads_more_certain(ratio: float, expected: float) -> None:
    condition = ModelError.of({}, {"vented pulls on tip": ratio}).vented
    across, along = Load("x", "force", (0.8, 0.6, 0.0), "tip"), Load("z", "force", (0.0, 0.0, 1.0), "tip")
    torque = Load("torque", "moment", (0.0, 0.0, 1.0), "tip")
    assert condition.load_ratio(across) == ratio
    assert condition.load_ratio(along) == condition.load_ratio(torque) == expected


@pytest.mark.parametrize(
    "sensor",
    [MeasuredPose("frame_tip", 0, 4e-3, 0.03), Orientation("orientation_tip", 0, 0.03)],
    ids=lambda sensor: sensor.name,
)
def test_torsion_scatters_apart_from_bending(sensor: Measurement) -> None:
    noise = widened(SensorSuite((sensor,)), SCATTER | {"frame_tip torsion": 0.4}).noise
    np.testing.assert_allclose(noise[-3:], [0.05, 0.05, np.hypot(0.03, 0.4)])


@pytest.mark.parametrize(
    ("sensor", "expected"),
    [
        (Bend("bend_tip", 0, 0.03), [np.hypot(0.03, 0.02)] * 2),
        (MeasuredPose("frame_tip", 0, 4e-3, 0.03), [5e-3] * 3 + [0.05] * 3),
        (Orientation("orientation_tip", 0, 0.03), [0.05] * 3),
        (Orientation("frame_tip", 0, np.full(3, 0.03)), [0.05] * 3),
        (Bend("bend_lower", 0, 0.03), [0.03] * 2),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_noise_of_sensor_and_model_add_up(sensor: Measurement, expected: list[float]) -> None:
    noise = widened(SensorSuite((sensor,)), ModelError.of(SCATTER).vented.scatter | {"bend_tip": 0.02}).noise
    np.testing.assert_allclose(noise, expected)


def test_an_orientation_that_the_calibration_saw_has_a_scatter_of_its_own() -> None:
    suite = SensorSuite((Orientation("orientation_tip", 0, 0.03),))
    np.testing.assert_allclose(widened(suite, SCATTER | {"orientation_tip": 0.4}).noise, np.hypot(0.03, 0.4))


def test_a_bend_that_the_calibration_did_not_see_errs_as_the_rotation_of_its_section() -> None:
    suite = SensorSuite((Bend("bend_tip", 0, 0.03),))
    np.testing.assert_allclose(widened(suite, {"frame_tip rotation": 0.04}).noise, 0.05)
