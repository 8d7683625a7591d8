"""The models that experiments run on, built once per specimen."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arm import build_arm, default_loads
from softarm.estimator.calibration import NodeSolver, Solver, section_forces
from softarm.estimator.calibration.solver import Response
from softarm.estimator.model import ArmModel, Load
from softarm.estimator.specimen import Specimen

Advance = Callable[[float], None]


Floats = NDArray[np.float64]

NEAR_PA = 15e3
NEAR_N = 0.3


def known_force_solver(specimen: Specimen, advance: Advance = lambda _: None) -> Solver:
    """Give what a calibration solves: the model with three known forces on every section."""
    return NodeSolver(build_arm(specimen, loads=section_forces(specimen)), advance)


@dataclass
class SharedSolutions:
    """Answers of models of one arm, at which others of the same arm begin at nearly the same inputs.

    Args:
        found: Pressures [Pa] and loads [N] of a batch, and the answer to it.
    """

    found: list[tuple[Floats, Floats, Response]] = field(default_factory=list)

    def near(self, pressures: Floats, loads: Floats) -> Response | None:
        """Give the newest answer to a batch of the same nodes."""
        for before, pulled, response in reversed(self.found):
            if _alike(before, pressures, NEAR_PA) and _alike(pulled, loads, NEAR_N):
                return response
        return None


@dataclass(frozen=True)
class WarmSolver:
    """A solver that begins at the answers of others; implements ``softarm.estimator.calibration.Solver``.

    Args:
        solver: The solver.
        answers: Their answers; its own are added.
    """

    solver: Solver
    answers: SharedSolutions

    @property
    def sections(self) -> tuple[str, ...]:
        """Names of the sections."""
        return self.solver.sections

    @property
    def factors(self) -> tuple[str, ...]:
        """Names of the stiffness factors."""
        return self.solver.factors

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads whose amplitudes are inputs."""
        return self.solver.loads

    def respond(
        self,
        scales: Mapping[str, float],
        pressures: Floats,
        loads: Floats,
        gravity: Floats,
        memory: Response | None,
    ) -> Response:
        """Solve at many pressures and loads; see ``softarm.estimator.calibration.Solver.respond``."""
        if memory is None:
            memory = self.answers.near(pressures, loads)
        response = self.solver.respond(scales, pressures, loads, gravity, memory)
        self.answers.found.append((pressures, loads, response))
        return response


def _alike(one: Floats, other: Floats, tolerance: float) -> bool:
    return one.shape == other.shape and bool(np.abs(one - other).max(initial=0.0) < tolerance)


def tracking_model(specimen: Specimen, loads: Sequence[Load] | None = None) -> ArmModel[Any, Any]:
    """Give what an estimate runs on; two lateral forces on every section where no loads are named."""
    return build_arm(specimen, loads=default_loads(specimen) if loads is None else loads)


def hand_loads(specimen: Specimen, section: str) -> tuple[Load, ...]:
    """Give the force of a hand on one section."""
    return tuple(load for load in section_forces(specimen) if load.section == section)


def wrench_loads(specimen: Specimen, section: str) -> tuple[Load, ...]:
    """Give force and torque on one section, the torque about the arm's axis at the base alone."""
    return (
        *hand_loads(specimen, section),
        Load(f"{section}_torque", "moment", (0.0, 0.0, 1.0), section=section),
    )
