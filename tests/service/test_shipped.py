"""The specimen that travels with the fakes holds what estimates read of a calibration."""

from softarm.common.shipped import fake_specimen
from softarm.estimator.sensing import ModelError
from softarm.estimator.sensing.model_error import UNPULLED_ERROR
from softarm.estimator.specimen import load_specimen


def test_the_deviation_of_a_force_is_that_of_the_calibration() -> None:
    calibration = load_specimen(fake_specimen()).calibration
    error = ModelError.of(calibration.scatter, calibration.force_ratio, calibration.force_error)
    for condition in error.conditions:
        tip, intermediate = map(condition.relative_error, ("tip", "intermediate"))
        assert 0.0 < tip < intermediate < UNPULLED_ERROR
