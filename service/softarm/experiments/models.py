"""The models that experiments run on, built once per specimen."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from softarm.estimator.arm import build_arm, default_loads
from softarm.estimator.arrays import Floats
from softarm.estimator.calibration import section_forces
from softarm.estimator.model import ArmModel, Load
from softarm.estimator.response import ArmResponse, BatchArmModel, BatchInputs
from softarm.estimator.sequential_batch import SequentialBatchModel
from softarm.estimator.specimen import Specimen
from softarm.estimator.wrapper import BatchModelWrapper

Advance = Callable[[float], None]


NEAR_PA = 15e3
NEAR_N = 0.3


def known_force_model(specimen: Specimen, advance: Advance = lambda _: None) -> BatchArmModel:
    """Return what a calibration solves: the model with three known forces on every section."""
    return SequentialBatchModel(build_arm(specimen, loads=section_forces(specimen)), advance)


@dataclass
class SharedSolutions:
    """Responses of models of one arm, from which others of the same arm begin at nearly the same inputs.

    Args:
        solved: Pressures [Pa] and loads [N] of each batch, and the response to it.
    """

    solved: list[tuple[Floats, Floats, ArmResponse]] = field(default_factory=list)

    def near(self, pressures: Floats, loads: Floats) -> ArmResponse | None:
        """Return the newest response to a batch of the same nodes."""
        for before, pulled, response in reversed(self.solved):
            if _alike(before, pressures, NEAR_PA) and _alike(pulled, loads, NEAR_N):
                return response
        return None


@dataclass(frozen=True)
class WarmModel(BatchModelWrapper):
    """A model that begins at the responses of others; implements ``BatchArmModel``.

    Args:
        responses: Their responses; its own are added, and copies with other stiffness factors share them.
    """

    responses: SharedSolutions

    def evaluate(
        self, inputs: BatchInputs, *, start: ArmResponse | None = None, jacobians: bool = True
    ) -> ArmResponse:
        """Solve many samples; see ``BatchArmModel.evaluate``."""
        if start is None:
            start = self.responses.near(inputs.pressures, inputs.loads)
        response = self.model.evaluate(inputs, start=start, jacobians=jacobians)
        self.responses.solved.append((inputs.pressures, inputs.loads, response))
        return response


def _alike(one: Floats, other: Floats, tolerance: float) -> bool:
    return one.shape == other.shape and bool(np.abs(one - other).max(initial=0.0) < tolerance)


def tracking_model(specimen: Specimen, loads: Sequence[Load] | None = None) -> ArmModel[Any, Any]:
    """Return what an estimate runs on; two lateral forces on every section where no loads are named."""
    return build_arm(specimen, loads=default_loads(specimen) if loads is None else loads)


def hand_loads(specimen: Specimen, section: str) -> tuple[Load, ...]:
    """Return the force of a hand on one section."""
    return tuple(load for load in section_forces(specimen) if load.section == section)


def wrench_loads(specimen: Specimen, section: str) -> tuple[Load, ...]:
    """Return force and torque on one section, the torque about the arm's axis at the base alone."""
    return (
        *hand_loads(specimen, section),
        Load(f"{section}_torque", "moment", (0.0, 0.0, 1.0), section=section),
    )
