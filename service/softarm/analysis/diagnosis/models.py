"""The model that a diagnosis runs on: the calibrated rod where there is one, else finite elements."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arm import build_arm
from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.stage import Model
from softarm.estimator.fem import FiniteElementModel, FiniteElementState
from softarm.estimator.geometry import Resolution
from softarm.estimator.model import Frames, Inputs
from softarm.estimator.response import ArmResponse, BatchInputs
from softarm.estimator.rod.model import CalibratedRod
from softarm.estimator.simulation import Segments, section_loads
from softarm.estimator.specimen import Specimen
from softarm.estimator.wrapper import ModelWrapper

Answer = tuple[Floats, Floats, Floats, Floats, bool]

PRESSURE_GRAIN = 20.0
LOAD_GRAIN = 1e-5
"""Inputs that differ by less [Pa; N, N m, m/s2] are solved once."""
COARSE = {kind: Resolution(layers=1) for kind in ("quadrant_cylinder", "cylinder")}
"""Meshes of bodies whose usual mesh takes seconds to solve; calibration absorbs their excess stiffness."""
BUDGET = 150.0
"""Seconds for which finite elements are solved at all, so that a diagnosis ends."""


def rod_model(specimen: Specimen, rod: CalibratedRod) -> Model:
    """Diagnose on a calibrated rod of the specimen."""
    rod = rod.with_loads(section_loads(tuple(rod.sections)))
    step = rod.linearise(rod.rest(), Inputs(np.zeros(rod.chambers), np.zeros(len(rod.loads)), np.zeros(3)))
    segments = Segments.of(specimen, tuple(rod.sections), step.frames)
    return Model(specimen, rod, segments, fast=True)


@dataclass(frozen=True)
class SparseModel(ModelWrapper):
    """Finite elements that solve equal inputs only once; implements ``BatchArmModel``.

    Args:
        model: The model with ``section_loads``.
        solved: Answers so far by stiffness factors and inputs; copies with other factors share them.
        deadline: Time of ``time.monotonic`` from which inputs that are not solved yet count as lost.
    """

    model: FiniteElementModel
    solved: dict[tuple[float, ...], Answer]
    deadline: float = float("inf")

    takes_eigenstrains = False

    @property
    def regions(self) -> tuple[str, ...]:
        """Names of the stiffness factors."""
        return tuple(self.model.parameters)

    def with_scales(self, scales: Mapping[str, float]) -> "SparseModel":
        """Return a copy with other stiffness factors."""
        known = {name: round(factor, 6) for name, factor in scales.items() if name in self.regions}
        return replace(self, model=self.model.with_scales(known))

    def evaluate(
        self,
        inputs: BatchInputs,
        *,
        start: ArmResponse | None = None,  # noqa: ARG002
        jacobians: bool = True,  # noqa: ARG002
    ) -> ArmResponse:
        """Solve many samples; see ``BatchArmModel.evaluate``."""
        assert inputs.eigenstrains is None, "finite elements take no eigenstrains here"
        every = np.broadcast_to(inputs.gravity, (len(inputs), 3))
        grains = np.round(
            np.hstack([inputs.pressures / PRESSURE_GRAIN, inputs.loads / LOAD_GRAIN, every / LOAD_GRAIN])
        )
        answers, state = [], self.model.rest()
        factors = tuple(self.model.scales.tolist())
        for grain, one in zip(grains.tolist(), inputs.samples(), strict=True):
            key = (*factors, *grain)
            if key not in self.solved and time.monotonic() > self.deadline:
                self.solved[key] = self._unsolved()
            elif key not in self.solved:
                self.solved[key], state = self._solve(one, state)
            answers.append(self.solved[key])
        positions, rotations, input_jacobian, by_factor, converged = map(np.array, zip(*answers, strict=True))
        frames = Frames(positions, rotations)
        return ArmResponse(frames, converged.astype(bool), self.chambers, input_jacobian, by_factor)

    def _unsolved(self) -> Answer:
        frames = self.model.section_frames(self.model.rest())
        rows, inputs = 6 * len(self.sections), self.chambers + len(self.loads) + 3
        none = np.zeros((rows, inputs)), np.zeros((rows, len(self.regions)))
        return frames.positions, frames.rotations, *none, False

    def _solve(self, inputs: Inputs, state: FiniteElementState) -> tuple[Answer, FiniteElementState]:
        model = self.model
        state, converged = model.solve(inputs, state)
        step = model.linearise(state, inputs)
        _, by_inputs, by_gravity, by_factor = step.full_response(np.eye(6 * len(model.sections)))
        derivatives = np.column_stack([by_inputs, by_gravity]), by_factor * model.scales
        answer = (step.frames.positions, step.frames.rotations, *derivatives, bool(converged))
        return answer, state if converged else model.rest()


def finite_element_model(specimen: Specimen) -> Model:
    """Diagnose on finite elements: for arms with few different inputs, or where no rod is at hand."""
    coarse = COARSE.get(specimen.geometry.kind)
    sections = tuple(build_arm(specimen, (), coarse).sections)
    fem = build_arm(specimen, section_loads(sections), coarse)
    segments = Segments.of(specimen, sections, fem.section_frames(fem.rest()))
    return Model(specimen, SparseModel(fem, {}, time.monotonic() + BUDGET), segments)
