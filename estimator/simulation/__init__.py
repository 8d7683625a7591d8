"""Forward simulation: what the arm does under pressures, loads and couples over time."""

from estimator.simulation.arm import Answers, Arm, SimulatedArm, linear_motion, section_loads
from estimator.simulation.drive import Drive, Response
from estimator.simulation.linear import LinearisedArm
from estimator.simulation.segments import Segments

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
