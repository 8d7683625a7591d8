"""Holding a pose: a ramp to the pressures that the model wants, then feedback on the measured pose."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class HoldGoal:
    """A pose to hold, told in the model's own pressures.

    The pose is described by the pressures that would hold it without any external force. Comparing these
    with the same description of the measured pose cancels what the model has wrong near the goal.

    Args:
        model_pressures: Pressures [Pa] that hold the wanted pose in the model, shape (chambers,).
        pressures: Pressures [Pa] to ramp to; they differ from the model's by what feedback had added when the
            pose was saved, shape (chambers,).
    """

    model_pressures: Floats
    pressures: Floats


@dataclass(frozen=True)
class Hold:
    """A hold in progress; each step gives the next one.

    Args:
        goal: What to hold.
        start: Pressures applied when it began [Pa], shape (chambers,).
        begin_ns: Monotonic time at which it began.
        ramp_s: Duration of the ramp.
        correction: Pressures that feedback has added [Pa], shape (chambers,).
    """

    goal: HoldGoal
    start: Floats
    begin_ns: int
    ramp_s: float
    correction: Floats

    def progress(self, now_ns: int) -> float:
        """Tell how far the ramp is, from 0 to 1."""
        return min(max((now_ns - self.begin_ns) * 1e-9 / self.ramp_s, 0.0), 1.0)


@dataclass(frozen=True)
class HoldLimits:
    """What feedback may do.

    Args:
        rate: Gain of the integral feedback [1/s].
        authority: Largest correction of a chamber [Pa].
        maximum: Largest pressure of each chamber [Pa], shape (chambers,).
    """

    rate: float
    authority: float
    maximum: Floats


def begin_hold(goal: HoldGoal, applied: Floats, now_ns: int, ramp_s: float) -> Hold:
    """Begin from what is applied now, so that nothing jumps."""
    return Hold(goal, applied.copy(), now_ns, ramp_s, np.zeros_like(goal.pressures))


def advance_hold(
    hold: Hold, measured_model_pressures: Floats | None, now_ns: int, interval_s: float, limits: HoldLimits
) -> tuple[Hold, Floats]:
    """Take one step of a hold.

    The set-point follows s(t) start + (1 - s(t)) goal with s a cubic from 1 to 0, so that it begins and ends
    without a jump of its rate. After the ramp an integral drives the measured pose to the goal:
    dc/dt = rate (p_goal - p_measured), both told in the model's pressures.

    Args:
        hold: The hold so far.
        measured_model_pressures: Pressures [Pa] that would hold the measured pose in the model, shape
            (chambers,); ``None`` while no estimate is at hand, which freezes the correction.
        now_ns: Monotonic time.
        interval_s: Time since the last step [s].
        limits: What feedback may do.

    Returns:
        The hold and the pressures to ask for [Pa], shape (chambers,).
    """
    progress = hold.progress(now_ns)
    if progress >= 1.0 and measured_model_pressures is not None:
        error = hold.goal.model_pressures - measured_model_pressures
        correction = hold.correction + limits.rate * interval_s * error
        hold = replace(hold, correction=np.clip(correction, -limits.authority, limits.authority))
    blend = progress * progress * (3.0 - 2.0 * progress)
    wanted = (1.0 - blend) * hold.start + blend * (hold.goal.pressures + hold.correction)
    return hold, np.clip(wanted, 0.0, limits.maximum)
