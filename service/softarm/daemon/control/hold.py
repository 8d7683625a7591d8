"""Holding a pose: a ramp to the pressures that the model wants, then feedback on the estimated pose."""

from dataclasses import dataclass, replace

import numpy as np

from softarm.daemon.estimation.messages import PoseTarget
from softarm.estimator.arrays import Floats


@dataclass(frozen=True)
class HoldGoal:
    """A pose to hold.

    Args:
        pressures: Pressures [Pa] to ramp to, shape (chambers,).
        target: The pose itself, to which feedback leads; ``None`` when it is not known.
    """

    pressures: Floats
    target: PoseTarget | None = None


@dataclass(frozen=True)
class HoldControl:
    """A hold in progress; each step returns the next one.

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
        """Return how far the ramp is, from 0 to 1."""
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


def begin_hold(goal: HoldGoal, applied: Floats, now_ns: int, ramp_s: float) -> HoldControl:
    """Begin from what is applied now, so that nothing jumps."""
    return HoldControl(goal, applied.copy(), now_ns, ramp_s, np.zeros_like(goal.pressures))


def advance_hold(
    hold: HoldControl, towards: Floats | None, now_ns: int, interval_s: float, limits: HoldLimits
) -> tuple[HoldControl, Floats]:
    """Compute one step of a hold.

    The set-point follows s(t) start + (1 - s(t)) goal with s a cubic from 1 to 0, so that it begins and ends
    without a jump of its rate. After the ramp an integral drives the estimated pose to the goal:
    dc/dt = rate dp, with dp the pressures that the model would add to get there.

    Args:
        hold: The hold so far.
        towards: Change of the pressures [Pa] that would bring the arm to the goal, shape (chambers,);
            ``None`` while no estimate is at hand, which freezes the correction.
        now_ns: Monotonic time.
        interval_s: Time since the last step [s].
        limits: What feedback may do.

    Returns:
        The hold and its set-points [Pa], shape (chambers,).
    """
    progress = hold.progress(now_ns)
    # During the ramp the pose is off by intention; an integral of that would overshoot.
    if progress >= 1.0 and towards is not None:
        correction = hold.correction + limits.rate * interval_s * towards
        hold = replace(hold, correction=np.clip(correction, -limits.authority, limits.authority))
    blend = progress * progress * (3.0 - 2.0 * progress)
    wanted = (1.0 - blend) * hold.start + blend * (hold.goal.pressures + hold.correction)
    return hold, np.clip(wanted, 0.0, limits.maximum)
