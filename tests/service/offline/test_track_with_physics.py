"""The offline estimator lets the specimen's physics act."""

from pathlib import Path

import numpy as np
import pytest

from softarm.analysis.offline.inputs import load_recordings
from softarm.analysis.offline.resample import resample
from softarm.analysis.offline.track import track
from softarm.estimator.arm import build_arm
from softarm.estimator.calibration import arrange
from softarm.estimator.errors import InputError
from softarm.estimator.specimen import Specimen, load_specimen
from softarm.estimator.specimen.calibration import Value
from softarm.estimator.specimen.physics import Parameter, Physics, Place
from tests.cli.test_estimate_and_calibrate import SCALE, WEIGHT, record

MASS = -WEIGHT / 9.81


def hung(mass: float, section: str = "tip") -> Specimen:
    """The beam as it is, with a weight on it that its drawing does not show."""
    beam = load_specimen("beam")
    scales = {"upper": Value(value=SCALE, std=0.01)}
    calibration = beam.calibration.model_copy(update={"modulus_scale": scales})
    weight = Physics(
        effect="tip_payload",
        where=Place(section=section),
        parameters={"mass": Parameter(value=mass, std=0.001, unit="kg")},
    )
    physics = (weight,) if mass else ()
    return beam.model_copy(update={"calibration": calibration, "physics": physics})


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(load_specimen("beam"), SCALE, WEIGHT, tmp_path_factory.mktemp("runs") / "loaded", 0.3)


def force(specimen: Specimen, path: Path) -> float:
    (recording,) = load_recordings([path])
    model = build_arm(specimen)
    run = resample(arrange(recording, specimen, model.sections), 10.0)
    found = track(model, specimen, run)
    assert np.all(found.status == 0)
    return float(np.mean(found.forces[:, 0]))


def test_a_weight_in_the_specimen_is_no_force_any_more(loaded: Path):
    assert force(hung(0.0), loaded) == pytest.approx(WEIGHT, rel=0.03)
    assert abs(force(hung(MASS), loaded)) < 0.03 * abs(WEIGHT)


def test_physics_at_a_place_that_the_arm_lacks_is_refused(loaded: Path):
    with pytest.raises(InputError, match="no section 'elbow'"):
        force(hung(MASS, "elbow"), loaded)
