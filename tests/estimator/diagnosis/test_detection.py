"""Detection limits against counting, and against what a diagnosis finds."""

import numpy as np
import pytest

from softarm.analysis.diagnosis.workers import Inline
from softarm.estimator.diagnosis.choose import LEAST_BIC
from softarm.estimator.diagnosis.detection import by_effect, limit, required_gain
from softarm.estimator.diagnosis.diagnose import diagnose
from softarm.estimator.diagnosis.result import DetectionLimit, Diagnosis
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.linear_arm import model, trial

TRIED = ("chamber_gain", "segment_stiffness", "sensor_bias")
PLACE = Place(chamber=1)


@pytest.mark.parametrize(("information", "spread"), [(1.0, 1e9), (300.0, 1e9), (300.0, 0.2), (1e5, 0.001)])
def test_nine_of_ten_effects_at_their_limit_pay_for_themselves(information: float, spread: float) -> None:
    size = limit(information, 47.0, spread)
    rng = np.random.default_rng(1)
    gains = (size * np.sqrt(information) + rng.normal(size=20000)) ** 2
    found = (gains > 47.0 + min((size / spread) ** 2, 12.0)).mean()
    assert found == pytest.approx(0.9, abs=0.01)


def test_what_leaves_no_trace_has_no_limit() -> None:
    assert limit(0.0, 47.0, 1.0) == np.inf


def test_a_longer_recording_must_gain_more_and_a_search_that_finds_much_by_chance_too() -> None:
    assert required_gain(7.0, 2, 5.0, 100.0) == LEAST_BIC + 14.0
    assert required_gain(7.0, 2, 90.0, 100.0) == 104.0
    assert required_gain(7.0, 2, 5.0, 25e3) == pytest.approx(2500.0)


def diagnosed(gain: float) -> Diagnosis:
    return diagnose(model(), trial([("chamber_gain", PLACE, (gain,))]), Inline(), effects=TRIED).diagnosis


@pytest.fixture(scope="module")
def unchanged() -> Diagnosis:
    return diagnosed(0.0)


def gain_limit(found: Diagnosis) -> float:
    (own,) = (one for one in found.detection_limits if (one.effect, one.where) == ("chamber_gain", PLACE))
    return own.size


def test_an_effect_above_its_limit_is_found_and_one_far_below_is_not(unchanged: Diagnosis) -> None:
    size = gain_limit(unchanged)
    assert not unchanged.findings
    above, below = diagnosed(-1.3 * size).findings, diagnosed(-0.3 * size).findings
    assert [(one.effect, one.where) for one in above] == [("chamber_gain", PLACE)]
    assert not below


def test_limits_do_not_depend_on_what_is_found(unchanged: Diagnosis) -> None:
    assert gain_limit(diagnosed(-0.15)) == pytest.approx(gain_limit(unchanged), rel=0.35)


def test_the_page_states_the_place_where_an_effect_is_hardest_to_see(unchanged: Diagnosis) -> None:
    gains = [one.size for one in unchanged.detection_limits if one.effect == "chamber_gain"]
    (shown,) = (one for one in by_effect(unchanged.detection_limits) if one.effect == "chamber_gain")
    assert len(set(gains)) >= 6
    assert shown.size == max(gains)


def test_the_page_lists_lengths_and_angles_of_one_effect_apart() -> None:
    angle = DetectionLimit("sensor_bias", Place(sensor="bend_tip"), "bias_x", 0.004, "rad")
    length = DetectionLimit("sensor_bias", Place(sensor="marker_tip1"), "bias_x", 0.002, "m")
    assert by_effect([angle, length]) == [angle, length]
