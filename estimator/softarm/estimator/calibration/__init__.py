"""Calibration: from recordings to moduli, chamber gains and the alignment of sensors."""

from softarm.estimator.calibration.acceptance import (
    CalibrationRefusedError,
    MotionNotPredictedError,
    NotImprovedError,
    cautions,
)
from softarm.estimator.calibration.arrange import CalibrationRun, arrange
from softarm.estimator.calibration.calibrate import Options, calibrate, most_solves, with_bend_axes
from softarm.estimator.calibration.drift import Drift, check_drift
from softarm.estimator.calibration.identifiability import Identified
from softarm.estimator.calibration.outcome import Calibrated, Check, calibrated_specimen
from softarm.estimator.calibration.pulls import section_forces

__all__ = [
    "Calibrated",
    "CalibrationRefusedError",
    "CalibrationRun",
    "Check",
    "Drift",
    "Identified",
    "MotionNotPredictedError",
    "NotImprovedError",
    "Options",
    "arrange",
    "calibrate",
    "calibrated_specimen",
    "cautions",
    "check_drift",
    "most_solves",
    "section_forces",
    "with_bend_axes",
]
