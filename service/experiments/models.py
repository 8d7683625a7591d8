"""The models that experiments run on, built once per specimen."""

from collections.abc import Callable, Sequence
from typing import Any

from estimator.arm import build_arm, default_loads
from estimator.calibration import NodeSolver, Solver, section_forces
from estimator.model import ArmModel, Load
from estimator.specimen import Specimen

Advance = Callable[[float], None]


def known_force_solver(specimen: Specimen, advance: Advance = lambda _: None) -> Solver:
    """Give what a calibration solves: the model with three known forces on every section."""
    return NodeSolver(build_arm(specimen, loads=section_forces(specimen)), advance)


def tracking_model(specimen: Specimen, loads: Sequence[Load] | None = None) -> ArmModel[Any, Any]:
    """Give what an estimate runs on; two lateral forces on every section where no loads are named."""
    return build_arm(specimen, loads=default_loads(specimen) if loads is None else loads)


def lateral_loads(section: str) -> tuple[Load, ...]:
    """Give the two lateral forces on one section."""
    return (
        Load(f"{section}_x", "force", (1.0, 0.0, 0.0), section=section),
        Load(f"{section}_y", "force", (0.0, 1.0, 0.0), section=section),
    )


def hand_loads(section: str) -> tuple[Load, ...]:
    """Give the force of a hand on one section."""
    return (*lateral_loads(section), Load(f"{section}_z", "force", (0.0, 0.0, 1.0), section=section))


def wrench_loads(section: str) -> tuple[Load, ...]:
    """Give force and torque on one section, the torque about the arm's axis at the base alone."""
    return (
        *hand_loads(section),
        Load(f"{section}_torque", "moment", (0.0, 0.0, 1.0), section=section),
    )
