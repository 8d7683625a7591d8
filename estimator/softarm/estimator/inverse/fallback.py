"""An estimator on a fast model that answers while the search on an exact one has lost the arm."""

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
"""Newton steps from one equilibrium to the next; where these do not get there, it is found from rest."""
SETTLED = 1e-4
"""Out-of-balance force over the applied forces at which a search can begin."""


class Pursuit(Background[Inputs, tuple[State, Inputs] | None]):
    """Brings a model to one set of inputs after another in the background.

    Args:
        model: The model.
        reach: Largest step, in units of the inputs' scale.
    """

    def __init__(self, model: ArmModel[State, Any], reach: float) -> None:
        super().__init__(self._solve, "pursuit")
        self._model, self.reach = model, reach
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
        step = self._model.linearise(state, before)
        for _ in range(STEPS):
            share = self.reach / max(_distance(self._unknowns, at, goal), self.reach)
            change = share * (goal - at)
            state, at = self._model.advance(step, change), goal if share == 1.0 else at + change
            step = self._model.linearise(state, self._unknowns.inputs(at, inputs.gravity))
            if not step.residual_norm < 1.0:
                return None
            if step.residual_norm < SETTLED and share == 1.0:
                return state
        return None


def _distance(unknowns: Unknowns, one: Floats, other: Floats) -> float:
    """Return the largest difference of two vectors of inputs, in units of their scale."""
    return float(np.abs((one - other) / unknowns.scale).max())


class FallbackEstimator(Generic[State, Step]):
    """Follow an arm on an exact model, and on a fast one while the exact one has lost it.

    To bring the exact model to where the arm is after a search that did not converge takes up to a second.
    That is done in the background, at the inputs that the fast model finds meanwhile. The exact model takes
    over again as soon as a step of its search reaches from there to the present inputs.

    Args:
        exact: Estimator on the exact model.
        fast: Estimator on a model with the same chambers and loads that can begin at rest at any instant.
        pursuit: Solves the exact model; whoever makes it starts and ends it.
    """

    def __init__(
        self, exact: Estimator[State, Step], fast: Estimator[Any, Any], pursuit: Pursuit[State]
    ) -> None:
        self._exact, self._fast, self._pursuit = exact, fast, pursuit
        self._pursued: ArmEstimate[Any] | None = None
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
        self._lose()

    def update(self, time: float, readings: Floats, pressures: Floats, gravity: Floats) -> ArmEstimate[Any]:
        """Estimate at an instant, on the fast model while ``lost``; see ``Estimator.update``."""
        if self.lost:
            self._catch_up()
        if not self.lost:
            estimate = self._exact.update(time, readings, pressures, gravity)
            if estimate.converged:
                return estimate
            self._lose()
        estimate = self._fast.update(time, readings, pressures, gravity)
        if estimate.converged:
            self._pursued = estimate
            if self._pursuit.idle:
                self._pursuit.ask(estimate.inputs)
        return estimate

    def _lose(self) -> None:
        self.lost, self._pursued = True, None
        self._fast.reset()

    def _catch_up(self) -> None:
        """Begin where the exact model was solved last, if that is within reach of the last estimate."""
        found, at = self._pursuit.newest, self._pursued
        if found is None or at is None or not self._pursuit.idle:
            return
        if _distance(at.unknowns, at.unknowns.vector(found[1]), at.vector) <= self._pursuit.reach:
            self._exact.begin_at(*found)
            self.lost = False
