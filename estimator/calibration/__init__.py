"""Calibration: from recordings to moduli, chamber gains and the alignment of sensors."""

from estimator.calibration.arrange import Run, arrange
from estimator.calibration.calibrate import CalibrationRefusedError, Options, calibrate
from estimator.calibration.drift import Drift, check_drift
from estimator.calibration.identifiability import Identified
from estimator.calibration.outcome import Calibrated, Check, calibrated_specimen
from estimator.calibration.pulls import section_forces
from estimator.calibration.solver import BatchSolver, NodeSolver, Response, Solver

__all__ = [
    "BatchSolver",
    "Calibrated",
    "CalibrationRefusedError",
    "Check",
    "Drift",
    "Identified",
    "NodeSolver",
    "Options",
    "Response",
    "Run",
    "Solver",
    "arrange",
    "calibrate",
    "calibrated_specimen",
    "check_drift",
    "section_forces",
]
