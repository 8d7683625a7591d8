"""From readings to loads, pressures and frames: objectives and limits, one program, one search."""

from softarm.estimator.inverse.compensation import Compensation, approach, replace_loads, settle
from softarm.estimator.inverse.contact_profile import ContactPlace, ContactProfile
from softarm.estimator.inverse.estimate import Estimate
from softarm.estimator.inverse.limits import Limits
from softarm.estimator.inverse.minimise import Minimum, Status, Tolerances, minimise
from softarm.estimator.inverse.objectives import (
    Iterate,
    Objective,
    PressureReadings,
    Prior,
    Rows,
    SensorObjective,
)
from softarm.estimator.inverse.observability import Observability
from softarm.estimator.inverse.problem import (
    Problem,
    forces_problem,
    independent_prior,
)
from softarm.estimator.inverse.process import LoadProcess
from softarm.estimator.inverse.program import (
    QuadraticProgram,
    QuadraticSolution,
    build_program,
    solve_program,
)
from softarm.estimator.inverse.tracker import Estimator, TrackerSettings
from softarm.estimator.inverse.unknowns import Unknowns

__all__ = [
    "Compensation",
    "ContactPlace",
    "ContactProfile",
    "Estimate",
    "Estimator",
    "Iterate",
    "Limits",
    "LoadProcess",
    "Minimum",
    "Objective",
    "Observability",
    "PressureReadings",
    "Prior",
    "Problem",
    "QuadraticProgram",
    "QuadraticSolution",
    "Rows",
    "SensorObjective",
    "Status",
    "Tolerances",
    "TrackerSettings",
    "Unknowns",
    "approach",
    "build_program",
    "forces_problem",
    "independent_prior",
    "minimise",
    "replace_loads",
    "settle",
    "solve_program",
]
