"""A model whose effective pressures grow with the stretch of their chambers.

With p the pressures on unstretched chambers, s(x) the stretches and g the gain, the wrapped model receives
P = p (1 + g s). With C and D its section twists per unit of pressures and loads, d its Newton step at
unchanged inputs and E the rows of s, the stretches move by z = E (d + C dP + D dl), where
dP = (1 + g s) dp + g p (z + q), q being the stretches at the frames less those that P was made with.
"""

import math
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
        return max(self.step.residual_norm, self._pressures[2])

    def response(self, rows: Floats) -> tuple[Floats, Floats]:
        """Project the motion of the sections on rows; see ``Linearisation.response``."""
        drift, columns = self.step.response(rows)
        still, moved, _ = self._pressures
        whole, jacobian = np.empty(len(rows)), np.empty_like(columns)
        _compose(drift, columns, still, moved, whole, jacobian)
        return whole, jacobian

    @cached_property
    def _pressures(self) -> tuple[Floats, Floats, float]:
        """Change of the wrapped model's pressures: at unchanged inputs, (chambers,), and per input.

        Behind them stands the norm of the pressure that is lacking, over that of all.
        """
        law = self.model.law
        stretches, rows = law.linearise(self.frames)
        drift, columns = self.step.response(rows)
        still, moved = np.empty(len(rows)), np.empty_like(columns)
        lacking = _follow(
            drift, columns, self.inputs.pressures, law.gain, stretches, self.made_with, still, moved
        )
        return still, moved, lacking

    def inner(self, change: Floats) -> Floats:
        """Return the change of the wrapped model's inputs for that of these, shape (inputs,)."""
        still, moved, _ = self._pressures
        return np.concatenate([still + moved @ change, change[self.model.chambers :]])


@njit(cache=True, nogil=True)
def _follow(
    drift: Floats,
    columns: Floats,
    pressures: Floats,
    gain: float,
    stretches: Floats,
    made_with: Floats,
    still: Floats,
    moved: Floats,
) -> float:
    """Fill the change of the wrapped model's pressures; symbols as at the head of this file.

    Args:
        drift: E d, shape (chambers,).
        columns: E C, then E D, shape (chambers, inputs).
        pressures: p, shape (chambers,).
        gain: g.
        stretches: s at the iterate, shape (chambers,).
        made_with: s that P was made with, shape (chambers,).
        still: Filled with the change at unchanged inputs, shape (chambers,).
        moved: Filled with that per input, shape (chambers, inputs).

    Returns:
        Norm of g p q over that of p.
    """
    chambers, inputs = columns.shape
    kept, inverse = np.eye(chambers), np.empty((chambers, chambers))
    right, solution = np.empty((chambers, inputs + 1)), np.empty((chambers, inputs + 1))
    lacking, applied = 0.0, 0.0
    for r in range(chambers):
        lacking += (gain * pressures[r] * (stretches[r] - made_with[r])) ** 2
        applied += pressures[r] ** 2
        right[r, inputs] = drift[r]
        for c in range(inputs):
            right[r, c] = columns[r, c] * (1.0 + gain * stretches[c]) if c < chambers else columns[r, c]
        for c in range(chambers):
            push = gain * pressures[c]
            # (1 - E C g p) z = E (d + C (1 + g s) dp + D dl) + E C g p q.
            kept[r, c] -= columns[r, c] * push
            right[r, inputs] += columns[r, c] * push * (stretches[c] - made_with[c])
    invert(kept, inverse)
    product(inverse, right, solution)
    for r in range(chambers):
        push = gain * pressures[r]
        still[r] = push * (solution[r, inputs] + stretches[r] - made_with[r])
        for c in range(inputs):
            moved[r, c] = push * solution[r, c]
        moved[r, r] += 1.0 + gain * stretches[r]
    return math.sqrt(lacking) / max(math.sqrt(applied), LEAST_PA)


@njit(cache=True, nogil=True)
def _compose(
    drift: Floats, columns: Floats, still: Floats, moved: Floats, whole: Floats, jacobian: Floats
) -> None:
    """Fill drift and derivative by these inputs from those by the wrapped model's.

    Args:
        drift: Shape (rows,).
        columns: Shape (rows, inputs).
        still: Change of the wrapped model's pressures at unchanged inputs, shape (chambers,).
        moved: That per input, shape (chambers, inputs).
        whole: Filled, shape (rows,).
        jacobian: Filled, shape (rows, inputs).
    """
    chambers, inputs = moved.shape
    for r in range(len(columns)):
        whole[r] = drift[r]
        for k in range(chambers):
            whole[r] += columns[r, k] * still[k]
        for c in range(inputs):
            total = columns[r, c] if c >= chambers else 0.0
            for k in range(chambers):
                total += columns[r, k] * moved[k, c]
            jacobian[r, c] = total


@dataclass(frozen=True)
class StretchedModel(ModelWrapper, Generic[State, Step]):
    """A model whose effective pressures grow with stretch; implements ``ArmModel``.

    Its states are those of the wrapped model.

    Args:
        model: The model of the arm; it has the ``section_frames`` of any state.
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
        """Find the equilibrium under fixed inputs; the flag is true when it converged."""
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
    """Let a model's pressures follow the stretch, where the specimen's calibration has its effect."""
    if not specimen.calibration.stretch_gain.value:
        return model
    return StretchedModel(model, StretchLaw.of(specimen, tuple(model.sections)))
