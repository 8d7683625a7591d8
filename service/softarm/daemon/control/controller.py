"""The arm under control: mode, lease, set-points and holds, advanced by ticks and commands."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from softarm.daemon.config import ControlSettings, SafetySettings
from softarm.daemon.control.hold import HoldControl, HoldGoal, HoldLimits, advance_hold, begin_hold
from softarm.daemon.estimation.messages import HoldAnswer
from softarm.daemon.safety.lease import LeaseManager
from softarm.daemon.safety.modes import PRESSURISED, SERVICE, Mode, ModeMachine, Transition, Trigger
from softarm.drivers.errors import LimitError
from softarm.drivers.valves.limits import check_setpoint
from softarm.estimator.arrays import Floats


class ValveOutputs(Protocol):
    """What control needs of a valve bank."""

    @property
    def armed(self) -> bool:
        """Whether set-points are accepted."""

    def arm(self) -> None:
        """Accept set-points; the chambers stay vented until one comes."""

    def vent(self, reason: str) -> None:
        """Vent every chamber and accept no set-point until ``arm``."""

    def acknowledge(self) -> bool:
        """Request that the terminal clears the errors that it keeps; return whether there are any."""

    def command(self, setpoint: Sequence[float], lifetime_s: float) -> None:
        """Put a set-point in force from the next pass on [Pa]; it is refused when out of range."""


@dataclass(frozen=True)
class RequestedSetpoint:
    """A set-point of a client.

    Args:
        pressures: Gauge pressures [Pa], shape (chambers,).
        expires_ns: Monotonic time at which it ends.
    """

    pressures: Floats
    expires_ns: int


class Controller:
    """Decides the set-points of the valves, and is the only one to send them.

    Args:
        valves: The valve bank.
        limits: Largest gauge pressure of each chamber [Pa], shape (chambers,).
        control: Gains of the hold.
        safety: Lifetimes.
        observer: Called after every change of mode.
    """

    def __init__(
        self,
        valves: ValveOutputs,
        limits: Floats,
        control: ControlSettings,
        safety: SafetySettings,
        observer: Callable[[Transition], None] = lambda _: None,
    ) -> None:
        self.modes = ModeMachine(observer)
        self.lease = LeaseManager(safety.lease_s)
        self._valves = valves
        self._limits = limits
        self._lifetime_s = safety.setpoint_lifetime_s
        self._hold_limits = HoldLimits(control.hold_rate_per_s, control.hold_authority_pa, limits)
        self._requested: RequestedSetpoint | None = None
        self._hold: HoldControl | None = None
        self._setpoint = np.zeros_like(limits)

    @property
    def setpoint(self) -> Floats:
        """Set-points of the valves, gauge [Pa], shape (chambers,)."""
        return self._setpoint

    @property
    def commanding(self) -> bool:
        """Whether a set-point is in force that each tick renews."""
        return self._requested is not None or self._hold is not None

    @property
    def hold(self) -> HoldControl | None:
        """The hold in progress."""
        return self._hold

    def fire(self, trigger: Trigger, cause: str, by: str = SERVICE) -> Transition:
        """Change the mode; leaving the pressurised modes vents before anything else.

        Args:
            trigger: What happened.
            cause: Why, in words.
            by: The client that requested it, or ``service``.

        Raises:
            TransitionRefusedError: The present mode does not allow it.
            InterlockError: The valve bank does not let itself be armed; the mode stays.
        """
        after = self.modes.target(trigger)
        # The valves first, the mode last: an arm() that raises leaves the mode as it was, and a mode that
        # stands for vented chambers is never shown before they are vented.
        if trigger is Trigger.ARM:
            self._valves.arm()
        if after not in PRESSURISED:
            self._vent(f"{after}: {cause}")
        if after is not Mode.HOLDING:
            self._hold = None
        return self.modes.fire(trigger, cause, by)

    def _vent(self, reason: str) -> None:
        self._requested, self._hold = None, None
        self._setpoint = np.zeros_like(self._limits)
        self._valves.vent(reason)

    def acknowledge(self) -> bool:
        """Request that the valve terminal clears the errors that it keeps; return whether there are any."""
        return self._valves.acknowledge()

    def request_setpoint(self, pressures: Floats, lifetime_s: float, now_ns: int) -> Floats:
        """Put a set-point in force.

        Args:
            pressures: Gauge pressures [Pa], shape (chambers,).
            lifetime_s: How long it lives.
            now_ns: Monotonic time.

        Returns:
            The set-points of the valves [Pa].

        Raises:
            LimitError: A pressure is out of range; nothing changes.
        """
        self._command(pressures)  # may raise, so it comes before anything is kept
        self._requested = RequestedSetpoint(pressures, now_ns + round(lifetime_s * 1e9))
        self._setpoint = pressures
        return pressures

    def begin_hold(
        self, goal: HoldGoal, ramp_s: float, now_ns: int, cause: str, by: str = SERVICE
    ) -> Transition:
        """Ramp from the present set-points to a goal and hold it."""
        transition = self.fire(Trigger.HOLD, cause, by)
        self._hold = begin_hold(goal, self._setpoint, now_ns, ramp_s)
        return transition

    def tick(self, now_ns: int, interval_s: float, measured: HoldAnswer | None) -> Transition | None:
        """Renew the set-point in force for another tick.

        Args:
            now_ns: Monotonic time.
            interval_s: Time since the last tick [s].
            measured: Answer of the newest estimate on holding the pose, when there is one.

        Returns:
            The change of mode when the lease ran out, or when a hold exceeds the limits.
        """
        # Before the set-point is renewed: a client that has gone must not be served for one more tick.
        gone = self.lease.expire(now_ns)
        if gone is not None and self.modes.allows(Trigger.LEASE_LOST):
            return self.fire(Trigger.LEASE_LOST, f"{gone.holder} did not renew the lease")
        self._setpoint = self._target(now_ns, interval_s, measured)
        if self.modes.mode in PRESSURISED and self.commanding:
            try:
                self._command(self._setpoint)
            except LimitError as error:
                return self.fire(Trigger.FAULT, str(error))
        return None

    def _command(self, pressures: Floats) -> None:
        """Check pressures against the limits and command them; no other way leads to the valves."""
        check_setpoint("set_pressures", pressures.tolist(), self._limits.tolist())
        self._valves.command(tuple(float(p) for p in pressures), self._lifetime_s)

    def _target(self, now_ns: int, interval_s: float, measured: HoldAnswer | None) -> Floats:
        if self._hold is not None:
            towards = None if measured is None else measured.towards
            self._hold, wanted = advance_hold(self._hold, towards, now_ns, interval_s, self._hold_limits)
            # Kept after the hold: TEACH goes on with these pressures, which no client renews.
            self._requested = RequestedSetpoint(wanted, now_ns)
            return wanted
        if self._requested is None:
            return np.zeros_like(self._limits)
        # In TEACH and HOLDING no client renews them; there the lost lease ends them.
        follows_set_points = self.modes.mode in (Mode.ARMED, Mode.EXPERIMENT)
        if follows_set_points and now_ns >= self._requested.expires_ns:
            self._requested = None
            return np.zeros_like(self._limits)
        return self._requested.pressures

    def keep_setpoint(self, now_ns: int, lifetime_s: float) -> None:
        """Keep the present set-points for a while: leaving a hold must not vent at once."""
        self._requested = RequestedSetpoint(self._setpoint, now_ns + round(lifetime_s * 1e9))
