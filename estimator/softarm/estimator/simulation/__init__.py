"""Forward simulation: what the arm does under pressures, loads and couples over time."""

from softarm.estimator.simulation.arm import RespondingArm, SimulatedArm, section_loads, with_segments
from softarm.estimator.simulation.drive import Drive
from softarm.estimator.simulation.linear import LinearisedArm
from softarm.estimator.simulation.segments import Segments

__all__ = [
    "Drive",
    "LinearisedArm",
    "RespondingArm",
    "Segments",
    "SimulatedArm",
    "section_loads",
    "with_segments",
]
