"""From readings to loads, pressures and frames: objectives and limits, one program, one search."""

from softarm.estimator.inverse.compensation import Compensation, approach, replace_loads, settle
from softarm.estimator.inverse.contact_profile import ContactPlace, ContactProfile
from softarm.estimator.inverse.estimate import ArmEstimate, Problem
from softarm.estimator.inverse.fallback import BackgroundSolver, FallbackEstimator
from softarm.estimator.inverse.limits import InputBounds
from softarm.estimator.inverse.minimise import Minimum, Status, Tolerances, minimise
from softarm.estimator.inverse.objectives import (
    Iterate,
    Objective,
    PressureReadings,
    Prior,
    SensorObjective,
    WeightedRows,
)
from softarm.estimator.inverse.observability import Observability
from softarm.estimator.inverse.program import QuadraticProgram, build_program, solve_program
from softarm.estimator.inverse.tracker import Estimator, LoadProcess, TrackerSettings
from softarm.estimator.inverse.unknowns import Unknowns

__all__ = [
    "ArmEstimate",
    "BackgroundSolver",
    "Compensation",
    "ContactPlace",
    "ContactProfile",
    "Estimator",
    "FallbackEstimator",
    "InputBounds",
    "Iterate",
    "LoadProcess",
    "Minimum",
    "Objective",
    "Observability",
    "PressureReadings",
    "Prior",
    "Problem",
    "QuadraticProgram",
    "SensorObjective",
    "Status",
    "Tolerances",
    "TrackerSettings",
    "Unknowns",
    "WeightedRows",
    "approach",
    "build_program",
    "minimise",
    "replace_loads",
    "settle",
    "solve_program",
]
