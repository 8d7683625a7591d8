"""The pressures that hold the pose, from the estimate at hand."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from softarm.daemon.estimation.messages import HoldAnswer, PoseTarget
from softarm.estimator.arrays import Floats
from softarm.estimator.inverse import ArmEstimate, approach, replace_loads
from softarm.estimator.model import Frames
from softarm.estimator.rotations import from_quaternions
from softarm.estimator.sensing import ActuationMap, SensorSuite


@dataclass(frozen=True)
class HoldSolver:
    """What commands act on: finds the pressures that hold its estimated pose without a hand.

    Args:
        suite: The sensors.
        actuation: From measured to chamber pressures.
        limits: Largest gauge pressure of each chamber [Pa], shape (chambers,).
        pressures_before_effects: Maps the pressures in the chambers to those before the effects of the
            specimen's physics.
    """

    suite: SensorSuite
    actuation: ActuationMap
    limits: Floats
    pressures_before_effects: Callable[[Floats], Floats]

    def commanded(self, acting: Floats) -> Floats:
        """Return the pressures to command for pressures that are to act in the chambers [Pa]."""
        return self.actuation.to_measured(self.pressures_before_effects(acting))

    def answer(self, estimate: ArmEstimate[Any], tare: Floats, target: PoseTarget | None) -> HoldAnswer:
        """Find the pressures that would hold the estimated pose, and those towards a target.

        Args:
            estimate: The newest estimate.
            tare: Load amplitudes that count as zero, shape (loads,).
            target: A pose that is being held, or ``None``.
        """
        pressures = estimate.inputs.pressures
        if not estimate.converged or not np.isfinite(estimate.motion).all():
            note = "the estimate did not converge, so nothing is known of the pose"
            return HoldAnswer(np.zeros(len(self.limits)), reachable=False, note=note, valid=False)
        held = replace_loads(estimate, self.suite, self.limits, tare)
        wanted = self._clipped_command(pressures + held.change)
        if target is None:
            residuals = dict(estimate.residuals)
            return HoldAnswer(wanted, held.reachable, held.statement, residuals=residuals)
        frames = Frames(target.positions, from_quaternions(target.quaternions))
        applied = self.commanded(estimate.measured_pressures)
        nearer = approach(estimate, self.suite, self.limits, frames, applied, target.residuals)
        # The map has offsets, so the change to command is the difference of two commands.
        towards = self.commanded(pressures + nearer.change) - self.commanded(pressures)
        return HoldAnswer(wanted, nearer.reachable, nearer.statement, towards=towards)

    def _clipped_command(self, acting: Floats) -> Floats:
        return np.clip(self.commanded(acting), 0.0, self.limits)
