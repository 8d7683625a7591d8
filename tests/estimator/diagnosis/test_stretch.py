"""A specimen whose chambers are worth more under stretch is diagnosed as such."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from softarm.estimator.calibration.setting import Setting
from softarm.estimator.diagnosis.diagnose import diagnose
from softarm.estimator.diagnosis.nuisances import calibrate_sessions
from softarm.estimator.specimen import Specimen, Value, load_specimen
from softarm.estimator.stretch import StretchLaw
from tests.estimator.diagnosis.linear_arm import NOISE, SECTIONS, model, session

SOPRA = load_specimen("sopra")


def stretching(gain: float) -> Specimen:
    calibration = SOPRA.calibration.model_copy(update={"stretch_gain": Value(value=gain)})
    return SOPRA.model_copy(update={"calibration": calibration})


@pytest.fixture(scope="module")
def recorded() -> list:
    """Recordings of the straight arm whose pressures grow with the stretch."""
    specimen = stretching(0.8)
    setting = Setting.of(specimen, StretchLaw.of(specimen, SECTIONS))
    return [session(f"run_{k}", 10 + k, scales=(1.0, 1.0), setting=setting) for k in range(4)]


@pytest.mark.parametrize(("gain", "explained"), [(0.8, True), (0.0, False)])
def test_a_calibrated_stretch_law_counts_in_a_diagnosis(recorded: list, gain: float, explained: bool) -> None:
    diagnosed = model(stretching(gain))
    stages = [calibrate_sessions(diagnosed, recorded).stage(diagnosed, one) for one in recorded]
    left = np.sqrt(np.mean([np.nanmean(stage.residual**2) for stage in stages]))
    # The arm creeps a little as well, by 2 % of its motion.
    assert (left < 6 * NOISE) == explained, left / NOISE


def test_a_specimen_with_its_stretch_law_is_consistent(recorded: list) -> None:
    with ThreadPoolExecutor(1) as executor:
        outcome = diagnose(
            model(stretching(0.8)), recorded, executor, effects=["chamber_gain", "segment_stiffness"]
        )
    assert outcome.diagnosis.verdict == "consistent"
