"""The offline estimator takes the inertia of the arm out of the forces where the samples show a swing."""

import numpy as np
import pytest

from softarm.analysis.offline.track import track
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.model import Inputs, Load
from softarm.estimator.sensing import Orientation, SensorSuite
from softarm.estimator.specimen import load_specimen
from tests.estimator.inverse.toy_arm import ToyArm

SUITE = SensorSuite((Orientation("middle", 0, 1e-3), Orientation("end", 1, 1e-3)))
ARM = ToyArm((Load("tip_x", "force", (1.0, 0.0, 0.0), section="tip"),))
HOLDING = 0.05
PERIOD = 1.0


def swinging(step: float) -> CalibrationRun:
    specimen = load_specimen("sopra")
    time = np.arange(0.0, 1.0, step)
    readings, state = [], ARM.rest()
    for force in HOLDING * np.cos(2.0 * np.pi * time / PERIOD):
        loads = np.array([force])
        state, _ = ARM.solve(Inputs(np.zeros(6), loads, np.array(specimen.gravity_m_s2)), state)
        readings.append(SUITE.predict(ARM.frames(state)))
    pressures = np.zeros((len(time), 6))
    return CalibrationRun("swing", time, pressures, ("measured",) * 6, SUITE, np.array(readings))


@pytest.mark.parametrize(("step", "shows"), [(0.02, True), (0.5, False)])
def test_forces_are_without_inertia_where_samples_show_a_swing(step: float, shows: bool) -> None:
    run = swinging(step)
    found = track(ARM, load_specimen("sopra"), run)
    held = HOLDING * np.cos(2.0 * np.pi * run.time / PERIOD)
    apart = np.abs(found.forces[:, 0] - held).max()
    assert bool(apart > 0.5 * HOLDING) is shows
