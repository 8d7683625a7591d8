"""Forward simulation: what the arm does under pressures, loads and couples over time."""

from softarm.estimator.simulation.arm import Arm, SimulatedArm, section_loads, with_segments
from softarm.estimator.simulation.drive import Drive
from softarm.estimator.simulation.linear import LinearisedArm
from softarm.estimator.simulation.segments import Segments

__all__ = [
    "Arm",
    "Drive",
    "LinearisedArm",
    "Segments",
    "SimulatedArm",
    "section_loads",
    "with_segments",
]
