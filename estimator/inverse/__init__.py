"""From readings to loads, pressures and frames: objectives and limits, one program, one search."""

from estimator.inverse.compensation import Compensation, approach, replace_loads, settle
from estimator.inverse.contact import ContactLocation, ContactSearch, locate_force
from estimator.inverse.contact_profile import ContactPlace, ContactProfile
from estimator.inverse.estimate import Estimate
from estimator.inverse.limits import Limits
from estimator.inverse.minimise import Minimum, Status, Tolerances, minimise
from estimator.inverse.objectives import (
    Iterate,
    Objective,
    PressureReadings,
    Prior,
    Rows,
    SensorObjective,
)
from estimator.inverse.observability import Observability
from estimator.inverse.problem import (
    Problem,
    forces_problem,
    independent_prior,
    inputs_problem,
    pose_problem,
)
from estimator.inverse.process import LoadProcess
from estimator.inverse.program import QuadraticProgram, QuadraticSolution, build_program, solve_program
from estimator.inverse.reach import Reach, reach_pose
from estimator.inverse.rectify import REST_PARAMETERS, Rectified, rectify
from estimator.inverse.tracker import Estimator, TrackerSettings
from estimator.inverse.unknowns import Unknowns

__all__ = [
    "REST_PARAMETERS",
    "Compensation",
    "ContactLocation",
    "ContactPlace",
    "ContactProfile",
    "ContactSearch",
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
    "Reach",
    "Rectified",
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
    "inputs_problem",
    "locate_force",
    "minimise",
    "pose_problem",
    "reach_pose",
    "rectify",
    "replace_loads",
    "settle",
    "solve_program",
]
