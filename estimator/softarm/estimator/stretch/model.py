"""A model whose effective pressures grow with the stretch of their chambers.

With p the pressures on unstretched chambers, s(x) the stretches and g the gain, the wrapped model is given
P = p (1 + g s). With C and D its section twists per unit of pressures and loads, d its Newton step at
unchanged inputs and E the rows of s, the stretches move by z = E (d + C dP + D dl), where
dP = (1 + g s) dp + g p (z + q), q being the stretches at the frames less those that P was made with.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Generic, TypeVar

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.model import ArmModel, Frames, Inputs, Linearisation, Load
from softarm.estimator.specimen import Specimen
from softarm.estimator.stretch.law import StretchLaw
from softarm.estimator.wrapper import ModelWrapper

State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)

PASSES = 12
SETTLED = 1e-6
"""Residual over the applied forces at which pressures and stretches agree."""
LEAST_PA = 1.0
"""Pressures below this are none: they are not divided by."""


@dataclass(frozen=True)
class StretchedStep(Generic[State, Step]):
    """The wrapped model's linearisation, with pressures that follow the stretch.

    Args:
        inputs: Pressures on unstretched chambers, loads, gravity.
        made_with: Stretches that the wrapped model's pressures were made with, shape (chambers,).
        step: The wrapped model's linearisation.
    """

    model: "StretchedModel[State, Step]"
    inputs: Inputs
    made_with: Floats
    step: Step

    @property
    def frames(self) -> Frames:
        """Frames of the sections at the iterate."""
        return self.step.frames

    @cached_property
    def residual_norm(self) -> float:
        """Norm of the out-of-balance force over that of the applied forces.

        Pressures that do not belong to the stretch at the iterate are out of balance: a wrapped model that
        finds its equilibrium has left the state whose stretch they were made with.
        """
        applied = max(float(np.linalg.norm(self.inputs.pressures)), LEAST_PA)
        return max(self.step.residual_norm, float(np.linalg.norm(self._push * self._behind)) / applied)

    @cached_property
    def _stretches(self) -> Floats:
        """Stretches at the iterate, shape (chambers,)."""
        return self.model.law.stretches(self.frames)

    @property
    def _behind(self) -> Floats:
        """Stretches that the wrapped model's pressures do not have yet, shape (chambers,)."""
        return self._stretches - self.made_with

    @property
    def _push(self) -> Floats:
        """Effective pressures per unit of stretch [Pa], shape (chambers,)."""
        return self.model.law.gain * self.inputs.pressures

    def response(self, rows: Floats) -> tuple[Floats, Floats]:
        """Project the motion of the sections on rows; see ``Linearisation.response``."""
        drift, columns = self.step.response(rows)
        still, moved = self._pressures
        chambers = self.model.chambers
        input_jacobian = columns[:, :chambers] @ moved
        input_jacobian[:, chambers:] += columns[:, chambers:]
        return drift + columns[:, :chambers] @ still, input_jacobian

    @cached_property
    def _pressures(self) -> tuple[Floats, Floats]:
        """Change of the wrapped model's pressures: at unchanged inputs, (chambers,), and per input."""
        law, chambers = self.model.law, self.model.chambers
        drift, columns = self.step.response(law.rows(self.frames))
        push, behind = self._push, self._behind
        direct = np.zeros((chambers, columns.shape[1]))
        direct[:, :chambers] = np.diag(1.0 + law.gain * self._stretches)
        kept = np.eye(chambers) - columns[:, :chambers] * push
        still = np.linalg.solve(kept, drift + columns[:, :chambers] @ (push * behind))
        input_jacobian = columns[:, :chambers] @ direct
        input_jacobian[:, chambers:] += columns[:, chambers:]
        moved = np.linalg.solve(kept, input_jacobian)
        return push * (still + behind), direct + push[:, None] * moved

    def inner(self, change: Floats) -> Floats:
        """Return the change of the wrapped model's inputs for that of these, shape (inputs,)."""
        still, moved = self._pressures
        return np.concatenate([still + moved @ change, change[self.model.chambers :]])


@dataclass(frozen=True)
class StretchedModel(ModelWrapper, Generic[State, Step]):
    """A model whose effective pressures grow with stretch; implements ``ArmModel``.

    Its states are those of the wrapped model.

    Args:
        model: The model of the arm; it gives the ``section_frames`` of any state.
        law: The stretch of its chambers and the effective pressures it makes.
    """

    model: ArmModel[State, Step]
    law: StretchLaw

    def with_loads(self, loads: Sequence[Load]) -> "StretchedModel[State, Step]":
        """Copy the model with other loads."""
        wrapped: Any = self.model
        return replace(self, model=wrapped.with_loads(loads))

    def rest(self) -> State:
        """Return the unloaded state."""
        return self.model.rest()

    def refreshed(self, state: State) -> State:
        """Return a state without what earlier linearisations left in it to be used again."""
        return self.model.refreshed(state)

    def linearise(self, state: State, inputs: Inputs) -> StretchedStep[State, Step]:
        """Linearise about a state under given inputs."""
        placing: Any = self.model
        stretches = self.law.stretches(placing.section_frames(state))
        effective = replace(inputs, pressures=self.law.effective(inputs.pressures, stretches))
        return StretchedStep(self, inputs, stretches, self.model.linearise(state, effective))

    def advance(self, step: StretchedStep[State, Step], change: Floats) -> State:
        """Take the Newton step for inputs changed by ``change`` (pressures, then loads)."""
        return self.model.advance(step.step, step.inner(change))

    def solve(self, inputs: Inputs, start: State) -> tuple[State, bool]:
        """Find the equilibrium under fixed inputs; the flag tells whether it converged."""
        effective = replace(inputs, pressures=self.law.effective(inputs.pressures, np.zeros(self.chambers)))
        state, converged = self.model.solve(effective, start)
        unchanged = np.zeros(self.chambers + len(self.loads))
        for _ in range(PASSES if converged else 0):
            step = self.linearise(state, inputs)
            if step.residual_norm < SETTLED:
                return state, True
            state = self.advance(step, unchanged)
        return state, False


def stretched(model: ArmModel[State, Step], specimen: Specimen) -> ArmModel[State, Any]:
    """Let a model's pressures follow the stretch, where the specimen's calibration says so."""
    if not specimen.calibration.stretch_gain.value:
        return model
    return StretchedModel(model, StretchLaw.of(specimen, tuple(model.sections)))
