"""The offline estimator on an arm without pressure sensors, of which one chamber is opened at once."""

import numpy as np

from softarm.analysis.offline.track import actuation, track
from softarm.estimator.arm import build_arm
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.model import Inputs
from softarm.estimator.sensing import Registration, SensorSuite
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.specimen import load_specimen

SPECIMEN = load_specimen("single_segment")
ARM = build_arm(SPECIMEN)
NOMINAL = 37.5e3
"""Set-point of the strongest of the shared recordings of this arm [Pa]."""
ACTED = 0.85
"""Share of the set-point that acts: an error of more than the specimen's tenth."""


def opened_at_once() -> CalibrationRun:
    """Readings of the tip before a chamber is opened, while it fills, and when it is full."""
    sections = tuple(section.name for section in SPECIMEN.sections)
    sensors = SpecimenSensors(SPECIMEN, sections, Registration())
    suite = SensorSuite(tuple(sensors.marker(name) for name in ("tip1", "tip2", "tip3")))
    gravity, readings, state = np.array(SPECIMEN.gravity_m_s2), [], ARM.rest()
    for share in (0.0, 0.6, 1.0):
        pressures = np.array([share * ACTED * NOMINAL, 0.0, 0.0, 0.0])
        state, converged = ARM.solve(Inputs(pressures, np.zeros(len(ARM.loads)), gravity), state)
        assert converged
        readings.append(suite.predict(ARM.section_frames(state)))
    commanded = np.outer([0.0, NOMINAL, NOMINAL], [1.0, 0.0, 0.0, 0.0])
    source = ("commanded", "none", "none", "none")
    return CalibrationRun("opened", np.arange(3.0), commanded, source, suite, np.array(readings))


def test_chamber_that_was_never_opened_is_known_to_be_vented() -> None:
    sigma = actuation(SPECIMEN, opened_at_once()).chamber_sigma
    np.testing.assert_allclose(sigma, [0.1 * NOMINAL, 200.0, 200.0, 200.0])


def test_every_search_converges_and_vented_chambers_stay_vented() -> None:
    run = opened_at_once()
    found = track(ARM, SPECIMEN, run)
    assert np.all(found.status == 0)
    assert np.abs(found.pressures[:, 1:]).max() < 3.0 * 200.0
