"""The specimen that travels with the fakes holds what estimates read of a calibration."""

from softarm.common.shipped import fake_specimen
from softarm.estimator.sensing import ModelError
from softarm.estimator.specimen import load_specimen


def test_the_deviation_of_a_force_at_the_tip_rests_on_pulls_there() -> None:
    calibration = load_specimen(fake_specimen()).calibration
    for condition in ModelError.of(calibration.scatter, calibration.force_ratio).conditions:
        assert condition.relative_error("tip") == 0.0


def test_the_deviation_of_a_force_where_nobody_pulled_is_that_of_the_calibration() -> None:
    calibration = load_specimen(fake_specimen()).calibration
    for condition in ModelError.of(
        calibration.scatter, calibration.force_ratio, calibration.force_error
    ).conditions:
        assert condition.relative_error("intermediate") == calibration.force_error["intermediate"]
