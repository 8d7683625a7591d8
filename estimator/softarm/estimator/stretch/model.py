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
from numba import njit

from softarm.estimator.arrays import Floats
from softarm.estimator.model import ArmModel, Frames, Inputs, Linearisation, Load
from softarm.estimator.small_matrices import invert, product
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
    def _law(self) -> tuple[Floats, Floats]:
        """Stretches at the iterate, shape (chambers,), and their rows, shape (chambers, 6 sections)."""
        return self.model.law.linearise(self.frames)

    @property
    def _behind(self) -> Floats:
        """Stretches that the wrapped model's pressures do not have yet, shape (chambers,)."""
        return self._law[0] - self.made_with

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
        stretches, rows = self._law
        drift, columns = self.step.response(rows)
        still, moved = np.empty(len(rows)), np.empty_like(columns)
        _follow(drift, columns, self._push, self._behind, 1.0 + self.model.law.gain * stretches, still, moved)
        return still, moved

    def inner(self, change: Floats) -> Floats:
        """Return the change of the wrapped model's inputs for that of these, shape (inputs,)."""
        still, moved = self._pressures
        return np.concatenate([still + moved @ change, change[self.model.chambers :]])


@njit(cache=True, nogil=True)
def _follow(
    drift: Floats, columns: Floats, push: Floats, behind: Floats, growth: Floats, still: Floats, moved: Floats
) -> None:
    """Fill the change of the wrapped model's pressures; symbols as at the head of this file.

    Args:
        drift: E d, shape (chambers,).
        columns: E C, then E D, shape (chambers, inputs).
        push: g p, shape (chambers,).
        behind: q, shape (chambers,).
        growth: 1 + g s, shape (chambers,).
        still: Filled with that at unchanged inputs, shape (chambers,).
        moved: Filled with that per input, shape (chambers, inputs).
    """
    chambers, inputs = columns.shape
    kept, inverse = np.eye(chambers), np.empty((chambers, chambers))
    right, found = np.empty((chambers, inputs + 1)), np.empty((chambers, inputs + 1))
    for r in range(chambers):
        right[r, inputs] = drift[r]
        for c in range(inputs):
            right[r, c] = columns[r, c] * growth[c] if c < chambers else columns[r, c]
        for c in range(chambers):
            kept[r, c] -= columns[r, c] * push[c]
            right[r, inputs] += columns[r, c] * push[c] * behind[c]
    invert(kept, inverse)
    product(inverse, right, found)
    for r in range(chambers):
        still[r] = push[r] * (found[r, inputs] + behind[r])
        for c in range(inputs):
            moved[r, c] = push[r] * found[r, c]
        moved[r, r] += growth[r]


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
        pressures = self.law.effective(inputs.pressures, stretches)
        effective = Inputs(pressures, inputs.loads, inputs.gravity)
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
