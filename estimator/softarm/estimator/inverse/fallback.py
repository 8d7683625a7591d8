"""An estimator on a fast model that answers while the search on an exact one has lost the arm."""

import math
from typing import Any, Generic, TypeVar

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.background import Background
from softarm.estimator.inverse.estimate import ArmEstimate
from softarm.estimator.inverse.tracker import Estimator
from softarm.estimator.inverse.unknowns import Unknowns
from softarm.estimator.model import ArmModel, Inputs, Linearisation
from softarm.estimator.sensing import SensorSuite

State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)


STEPS = 30
"""Newton steps from one equilibrium to the next; where these do not suffice, it is solved from rest."""
SETTLED = 1e-4
"""Out-of-balance force over the applied forces at which a search can begin."""
STEADY_S = 0.1
"""So long the arm must have been within reach of one place before the exact model is brought there [s]."""


class BackgroundSolver(Background[Inputs, tuple[State, Inputs] | None]):
    """Brings a model to one set of inputs after another in the background.

    Args:
        model: The model.
        reach: Largest step, in units of the inputs' scale.
    """

    def __init__(self, model: ArmModel[State, Any], reach: float) -> None:
        super().__init__(self._solve, "background solver")
        self._model, self._reach = model, reach
        self._unknowns = Unknowns.of(model.chambers, model.loads)
        self._last: tuple[State, Inputs] | None = None

    def _solve(self, inputs: Inputs) -> tuple[State, Inputs] | None:
        state = None if self._last is None else self._stepped(*self._last, inputs)
        if state is None:
            state, converged = self._model.solve(inputs, self._model.rest())
            state = state if converged else None
        self._last = None if state is None else (state, inputs)
        return self._last

    def _stepped(self, state: State, before: Inputs, inputs: Inputs) -> State | None:
        """Go from one equilibrium to the next by short Newton steps; a tracking model reuses its factor."""
        at, goal = self._unknowns.vector(before), self._unknowns.vector(inputs)
        start, step = at, self._model.linearise(state, before)
        count = max(1, math.ceil(self._distance(before, inputs) / self._reach))
        for share in np.minimum(np.arange(1, STEPS + 1) / count, 1.0):
            there = start + share * (goal - start)
            state, at = self._model.advance(step, there - at), there
            step = self._model.linearise(state, self._unknowns.inputs(at, inputs.gravity))
            if not step.residual_norm < 1.0:
                return None
            if step.residual_norm < SETTLED and share == 1.0:
                return state
        return None

    def reaches(self, one: Inputs, other: Inputs) -> bool:
        """Return whether a single step leads from one set of inputs to another."""
        return self._distance(one, other) <= self._reach

    def _distance(self, one: Inputs, other: Inputs) -> float:
        away = self._unknowns.vector(other) - self._unknowns.vector(one)
        return float(np.abs(away / self._unknowns.scale).max())


class FallbackEstimator(Generic[State, Step]):
    """Follow an arm on an exact model, and on a fast one while the exact one has lost it.

    After a search that did not converge, it takes up to a second to bring the exact model to where the arm
    is. That is done in the background, at the inputs that the fast model estimates, once the arm has calmed
    down. The exact model takes over again when a step of its search reaches from there to the present inputs.

    Args:
        exact: Estimator on the exact model.
        fast: Estimator on a model with the same chambers and loads that can begin at rest at any instant.
        background: Solves the exact model; whoever makes it starts and ends it.
    """

    def __init__(
        self, exact: Estimator[State, Step], fast: Estimator[Any, Any], background: BackgroundSolver[State]
    ) -> None:
        self._exact, self._fast, self._background_solver = exact, fast, background
        self._newest: Inputs | None = None
        self._steady_since: tuple[float, Inputs] | None = None
        self._background_requested = False
        self.lost = True

    @property
    def model(self) -> ArmModel[State, Step]:
        """The exact model."""
        return self._exact.model

    def suite_at(self, pressures: Floats) -> SensorSuite:
        """Return the sensors, as noisy as they and the model are together at measured pressures [Pa]."""
        return self._exact.suite_at(pressures)

    def reset(self) -> None:
        """Forget the past."""
        self._exact.reset()
        self._mark_lost()

    def update(self, time: float, readings: Floats, pressures: Floats, gravity: Floats) -> ArmEstimate[Any]:
        """Estimate at an instant, on the fast model while ``lost``; see ``Estimator.update``."""
        if self.lost:
            self._resume_exact()
        if not self.lost:
            estimate = self._exact.update(time, readings, pressures, gravity)
            if estimate.converged:
                return estimate
            self._mark_lost()
        estimate = self._fast.update(time, readings, pressures, gravity)
        if estimate.converged:
            self._newest = estimate.inputs
            self._solve_in_background(time, estimate.inputs)
        return estimate

    def _mark_lost(self) -> None:
        self.lost, self._background_requested, self._newest, self._steady_since = True, False, None, None
        self._fast.reset()

    def _solve_in_background(self, time: float, inputs: Inputs) -> None:
        """Have the exact model brought to where the arm is, if it has been near there for a while."""
        if self._steady_since is None or not self._background_solver.reaches(self._steady_since[1], inputs):
            self._steady_since = time, inputs
        elif time - self._steady_since[0] > STEADY_S and self._background_solver.idle:
            self._background_requested = True
            self._background_solver.ask(inputs)

    def _resume_exact(self) -> None:
        """Begin where the exact model has been brought, if that is within reach of the last estimate."""
        if not (self._background_requested and self._background_solver.idle):
            return
        solved = self._background_solver.newest
        if (
            solved is not None
            and self._newest is not None
            and self._background_solver.reaches(solved[1], self._newest)
        ):
            self._exact.begin_at(*solved)
            self.lost = False
