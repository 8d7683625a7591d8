"""A recording at a lower rate: means of its samples, everything else as it was."""

from dataclasses import fields

import numpy as np

from softarm.analysis.offline.resample import resample
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.sensing import Orientation, SensorSuite

SAMPLES = {"time", "pressures", "readings", "loads"}


def test_only_the_samples_change() -> None:
    time = np.arange(0.0, 1.0, 0.01)
    run = CalibrationRun(
        "tilted",
        time,
        np.outer(time, np.ones(6)),
        ("measured",) * 6,
        SensorSuite((Orientation("tip", 1, 1e-3),)),
        np.tile([1.0, 0.0, 0.0, 0.0], (len(time), 1)),
        ignored_markers=("hook",),
        gravity=np.array([0.0, 9.81, 0.0]),
    )
    slow = resample(run, 10.0)
    np.testing.assert_allclose(slow.time, np.arange(0.045, 1.0, 0.1))
    np.testing.assert_allclose(slow.pressures[:, 0], slow.time)
    for field in fields(run):
        if field.name not in SAMPLES:
            assert getattr(slow, field.name) is getattr(run, field.name), field.name
