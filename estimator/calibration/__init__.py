"""Calibration: from recordings to moduli, chamber gains and the alignment of sensors."""

from estimator.calibration.arrange import Run, arrange
from estimator.calibration.calibrate import CalibrationRefusedError, Options, calibrate
from estimator.calibration.forward import ScaledLinearisation, ScaledModel
from estimator.calibration.identifiability import Identified
from estimator.calibration.outcome import Calibrated, Check, calibrated_specimen

__all__ = [
    "Calibrated",
    "CalibrationRefusedError",
    "Check",
    "Identified",
    "Options",
    "Run",
    "ScaledLinearisation",
    "ScaledModel",
    "arrange",
    "calibrate",
    "calibrated_specimen",
]
