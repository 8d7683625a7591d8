"""A model of the arm under known wrenches on its sections and on a base that yields.

The wrapped model responds to the wrenches of its sections in its own, unrotated base frame. With Q the
rotation of the base, B the wrenches per unit of the unknown loads a and w the known ones, its inputs are
Q^T (B a + w) and gravity Q^T g, and its frames and twists are rotated by Q.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.model import ArmModel, Frames, Inputs, Linearisation, Load
from softarm.estimator.wrapper import ModelWrapper

State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)


@dataclass(frozen=True)
class LoadDistribution:
    """How unknown loads act as wrenches on the sections.

    Args:
        loads: The loads, each on a section.
        sections: Names of the sections.

    Raises:
        InputError: A load acts elsewhere than on a section.
    """

    loads: tuple[Load, ...]
    sections: tuple[str, ...]

    def __post_init__(self) -> None:
        for load in self.loads:
            if load.section not in self.sections:
                raise InputError(f"load {load.name}", "acts on no section", "put it on a rigid section")

    @cached_property
    def matrix(self) -> Floats:
        """Wrenches of all sections, force before moment, per unit of each load, shape (6 sections, loads)."""
        columns = np.zeros((len(self.sections), 2, 3, len(self.loads)))
        for number, load in enumerate(self.loads):
            row = self.sections.index(load.section or "")
            columns[row, 0 if load.kind == "force" else 1, :, number] = load.direction
        return columns.reshape(-1, len(self.loads))


@dataclass(frozen=True)
class AugmentedStep(Generic[State, Step]):
    """The wrapped model's linearisation in the frame of the unrotated base."""

    model: "AugmentedModel[State, Step]"
    step: Step

    @property
    def frames(self) -> Frames:
        """Frames of the sections at the iterate."""
        base_rotation, inner = self.model.base_rotation, self.step.frames
        return Frames(inner.positions @ base_rotation.T, base_rotation @ inner.rotations)

    @property
    def residual_norm(self) -> float:
        """Norm of the out-of-balance force over that of the applied forces."""
        return self.step.residual_norm

    def response(self, rows: Floats) -> tuple[Floats, Floats]:
        """Project the motion of the sections on rows; see ``Linearisation.response``."""
        # Rows multiply translations and rotations in unrotated axes; the wrapped model moves in rotated ones.
        inner = (rows.reshape(-1, 3) @ self.model.base_rotation).reshape(rows.shape)
        drift, columns = self.step.response(inner)
        chambers = self.model.chambers
        return drift, np.concatenate(
            [columns[:, :chambers], columns[:, chambers:] @ self.model.shares], axis=1
        )


@dataclass(frozen=True)
class AugmentedModel(ModelWrapper, Generic[State, Step]):
    """A model under known wrenches and a rotated base; implements ``ArmModel``.

    Args:
        model: Model whose loads are the wrenches of its sections.
        distribution: The unknown loads.
        wrenches: Known wrenches in the base frame, shape (6 sections,).
        base_rotation: Rotation of the base, shape (3, 3).
    """

    model: ArmModel[State, Step]
    distribution: LoadDistribution
    wrenches: Floats
    base_rotation: Floats

    @property
    def loads(self) -> tuple[Load, ...]:
        """Loads whose amplitudes are inputs."""
        return self.distribution.loads

    @cached_property
    def shares(self) -> Floats:
        """Wrenches in the wrapped model's base frame per unit of each load, shape (6 sections, loads)."""
        return self._in_inner_axes(self.distribution.matrix)

    def _in_inner_axes(self, wrenches: Floats) -> Floats:
        blocks = wrenches.reshape(-1, 3, *wrenches.shape[1:])
        rotated: Floats = np.einsum("ji,bj...->bi...", self.base_rotation, blocks)
        return rotated.reshape(wrenches.shape)

    def inner_inputs(self, inputs: Inputs) -> Inputs:
        """Return the wrapped model's inputs."""
        acting = self._in_inner_axes(self.wrenches)
        return Inputs(
            inputs.pressures, self.shares @ inputs.loads + acting, self.base_rotation.T @ inputs.gravity
        )

    def rest(self) -> State:
        """Return the unloaded state."""
        return self.model.rest()

    def refreshed(self, state: State) -> State:
        """Return a state without what earlier linearisations left in it to be used again."""
        return self.model.refreshed(state)

    def linearise(self, state: State, inputs: Inputs) -> AugmentedStep[State, Step]:
        """Linearise about a state under given inputs."""
        return AugmentedStep(self, self.model.linearise(state, self.inner_inputs(inputs)))

    def advance(self, step: AugmentedStep[State, Step], change: Floats) -> State:
        """Take the Newton step for inputs changed by ``change`` (pressures, then loads)."""
        inner = np.concatenate([change[: self.chambers], self.shares @ change[self.chambers :]])
        return self.model.advance(step.step, inner)

    def solve(self, inputs: Inputs, start: State) -> tuple[State, bool]:
        """Find the equilibrium under fixed inputs; the flag is true when it converged."""
        return self.model.solve(self.inner_inputs(inputs), start)
