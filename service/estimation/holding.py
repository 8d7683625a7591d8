"""The pressures that hold the pose: from the estimate at hand, and a search on from there."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.inverse import Compensation, Estimate, Tolerances, approach, replace_loads, settle
from estimator.model import Frames
from estimator.rotations import from_quaternions
from estimator.sensing import ActuationMap, SensorSuite
from service.estimation.messages import HoldAnswer, PoseTarget

Floats = NDArray[np.float64]
SEARCH = Tolerances(step=1e-3, residual=1e-4, iterations=6, retreats=0)
"""A search that takes longer is given up; until one ends, the linear answer stands."""
SEARCH_EVERY = 5
"""Instants from one search to the next; between them the linear answer moves by what the last one added."""


@dataclass(frozen=True)
class Arm:
    """What commands act on.

    Args:
        suite: The sensors.
        actuation: From measured to chamber pressures.
        limits: Largest gauge pressure of each chamber [Pa], shape (chambers,).
        unshaped: From the pressures that act in the chambers to those before the specimen's physics.
    """

    suite: SensorSuite
    actuation: ActuationMap
    limits: Floats
    unshaped: Callable[[Floats], Floats]

    def commanded(self, acting: Floats) -> Floats:
        """Give the pressures to command for pressures that are to act in the chambers [Pa]."""
        return self.actuation.to_measured(self.unshaped(acting))


class Holding:
    """Finds the pressures that hold the estimated pose without a hand.

    Args:
        arm: What commands act on.
    """

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._last: Estimate[Any] | None = None
        self._beyond: Compensation | None = None
        self._instants = 0

    def forget(self) -> None:
        """Begin the next search anew, at once."""
        self._last, self._beyond, self._instants = None, None, 0

    def answer(
        self, model: Any, estimate: Estimate[Any], tare: Floats, target: PoseTarget | None
    ) -> HoldAnswer:
        """Find the pressures that would hold the estimated pose, and those towards a target.

        Args:
            model: The model of the estimate.
            estimate: The newest estimate.
            tare: Load amplitudes that count as zero, shape (loads,).
            target: A pose that is being held, or ``None``.
        """
        arm, pressures = self._arm, estimate.inputs.pressures
        if not estimate.converged or not np.isfinite(estimate.motion).all():
            self.forget()
            note = "the estimate did not converge, so nothing is known of the pose"
            return HoldAnswer(np.zeros(len(arm.limits)), reachable=False, note=note, known=False)
        held = replace_loads(estimate, arm.suite, arm.limits, tare)
        if target is None:
            held = self._settled(model, estimate, tare, held)
            return HoldAnswer(self._wanted(pressures + held.change), held.reachable, held.statement)
        self.forget()
        frames = Frames(target.positions, from_quaternions(target.quaternions))
        nearer = approach(estimate, arm.suite, arm.limits, frames)
        towards = arm.commanded(pressures + nearer.change) - arm.commanded(pressures)
        wanted = self._wanted(pressures + held.change)
        return HoldAnswer(wanted, nearer.reachable, nearer.statement, towards=towards)

    def _wanted(self, acting: Floats) -> Floats:
        return np.clip(self._arm.commanded(acting), 0.0, self._arm.limits)

    def _settled(
        self, model: Any, estimate: Estimate[Any], tare: Floats, first: Compensation
    ) -> Compensation:
        """Search now and then, from where the last search ended; after one that fails begin anew."""
        arm, last = self._arm, self._last
        if self._instants % SEARCH_EVERY == 0:
            start = None if last is None else (last.state, last.inputs)
            answer, self._last = settle(model, estimate, arm.suite, arm.limits, tare, first, start, SEARCH)
            found = self._last is not None
            self._beyond = replace(answer, change=answer.change - first.change) if found else None
        self._instants += 1
        return (
            first
            if self._beyond is None
            else replace(self._beyond, change=first.change + self._beyond.change)
        )
