"""Forward simulation: what the arm does under pressures, loads and couples over time."""

from softarm.estimator.simulation.arm import Answers, Arm, SimulatedArm, linear_motion, section_loads
from softarm.estimator.simulation.drive import Drive, Response
from softarm.estimator.simulation.linear import LinearisedArm
from softarm.estimator.simulation.segments import Segments

__all__ = [
    "Answers",
    "Arm",
    "Drive",
    "LinearisedArm",
    "Response",
    "Segments",
    "SimulatedArm",
    "linear_motion",
    "section_loads",
]
