"""The pressures that would hold the pose, followed from one instant to the next."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.inverse import Reach, Tolerances, reach_pose
from estimator.model import ArmModel, Inputs
from estimator.sensing import ActuationMap, SensorSuite
from service.estimation.messages import HoldAnswer

Floats = NDArray[np.float64]

TOLERANCES = Tolerances(step=1e-3, residual=1e-4, iterations=8)
"""A search goes on at the next instant where it stopped: no instant may wait for a long one."""


class HoldSearch:
    """Searches, a few steps an instant, for the pressures that hold the measured pose without any load.

    Args:
        model: Model of the arm.
        suite: The sensors whose readings describe the pose.
        actuation: From measured to chamber pressures.
        limits: Largest gauge pressure of each chamber [Pa], shape (chambers,).
    """

    def __init__(
        self, model: ArmModel[Any, Any], suite: SensorSuite, actuation: ActuationMap, limits: Floats
    ) -> None:
        self._model = model
        self._suite = suite
        self._actuation = actuation
        self._limits = limits
        self._memory: tuple[Any, Inputs] | None = None
        self._from_rest = False

    def forget(self) -> None:
        """Begin anew with the next call."""
        self._memory = None
        self._from_rest = False

    def __call__(self, readings: Floats, state: Any, inputs: Inputs) -> HoldAnswer:
        """Take a few steps towards the pressures that hold the pose.

        Args:
            readings: Stacked readings of the pose, NaN where absent, shape (readings,).
            state: The estimate's state, from which a new search begins.
            inputs: The estimate's inputs; its pressures are preferred where the pose leaves a choice.
        """
        start = self._memory or self._begin(state, inputs)
        chosen = np.clip(inputs.pressures, 0.0, self._limits)
        reach = reach_pose(
            self._model, self._suite, readings, self._limits, start, TOLERANCES, preferred=chosen
        )
        self._remember(reach)
        known = reach.estimate.converged
        wanted = np.clip(self._actuation.to_measured(np.nan_to_num(reach.pressures)), 0.0, self._limits)
        return HoldAnswer(wanted, reach.reachable, reach.statement, known)

    def _begin(self, state: Any, inputs: Inputs) -> tuple[Any, Inputs]:
        """Begin at the loaded pose; once that has failed, at rest."""
        if not self._from_rest:
            return state, inputs
        none = np.zeros(len(self._model.loads))
        return self._model.rest(), Inputs(np.zeros(self._model.chambers), none, inputs.gravity)

    def _remember(self, reach: Reach[Any]) -> None:
        estimate = reach.estimate
        lost = estimate.status == "diverged" or not np.isfinite(estimate.vector).all()
        if lost:
            self._from_rest = not self._from_rest
        self._memory = None if lost else (estimate.state, estimate.inputs)
