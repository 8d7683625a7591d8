"""The pressures that hold the pose, from the estimate at hand."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.inverse import Estimate, approach, replace_loads
from estimator.model import Frames
from estimator.rotations import from_quaternions
from estimator.sensing import ActuationMap, SensorSuite
from service.estimation.messages import HoldAnswer, PoseTarget

Floats = NDArray[np.float64]


def hold_pose(
    estimate: Estimate[Any],
    suite: SensorSuite,
    actuation: ActuationMap,
    limits: Floats,
    tare: Floats,
    target: PoseTarget | None,
) -> HoldAnswer:
    """Find the pressures that would hold the estimated pose without a hand, and those towards a target.

    Args:
        estimate: The newest estimate.
        suite: The sensors.
        actuation: From measured to chamber pressures.
        limits: Largest gauge pressure of each chamber [Pa], shape (chambers,).
        tare: Load amplitudes that count as zero, shape (loads,).
        target: A pose that is being held, or ``None``.
    """
    if not estimate.converged or not np.isfinite(estimate.motion).all():
        note = "the estimate did not converge, so nothing is known of the pose"
        return HoldAnswer(np.zeros(len(limits)), reachable=False, note=note, known=False)
    pressures = estimate.inputs.pressures
    held = replace_loads(estimate, suite, limits, tare)
    wanted = np.clip(actuation.to_measured(pressures + held.change), 0.0, limits)
    if target is None:
        return HoldAnswer(wanted, held.reachable, held.statement)
    frames = Frames(target.positions, from_quaternions(target.quaternions))
    nearer = approach(estimate, suite, limits, frames)
    towards = actuation.to_measured(pressures + nearer.change) - actuation.to_measured(pressures)
    return HoldAnswer(wanted, nearer.reachable, nearer.statement, towards=towards)
