"""The set-point of the valves: it expires, behind an interlock that never arms itself."""

from collections.abc import Sequence
from dataclasses import dataclass

from softarm.drivers.clock import NANOSECONDS, Clock, monotonic
from softarm.drivers.errors import InterlockError
from softarm.drivers.valves.limits import PressureLimits, check_setpoint, limit_lifetime, limit_step
from softarm.drivers.valves.pressures import ChamberMap, Pressures


@dataclass(frozen=True, slots=True)
class OutputWrite:
    """One write.

    Attributes:
        setpoint: The set-point [Pa]; None when the chambers are to be vented.
        applied: What the counts amount to [Pa].
        counts: Set-point of every valve [counts].
        expired: Whether a set-point ran out just now.
        acknowledge: Whether to clear the errors that the terminal keeps.
    """

    setpoint: Pressures | None
    applied: Pressures
    counts: tuple[int, ...]
    expired: bool = False
    acknowledge: bool = False


class Outputs:
    """Holds the set-point in force and converts it to writes.

    Args:
        device: The device, for errors.
        limits: Limits of the chambers.
        chambers: Which valve feeds which chamber.
        clock: Host monotonic time.
    """

    def __init__(
        self, device: str, limits: PressureLimits, chambers: ChamberMap, clock: Clock = monotonic
    ) -> None:
        self.limits = limits
        self.chambers = chambers
        self.armed = False
        self.reason = "it was not armed yet"
        self._device = device
        self._clock = clock
        self._setpoint: Pressures | None = None
        self._deadline_ns = 0
        self._acknowledge_until_ns = clock()
        self._level: Pressures = (0.0,) * len(limits.maximum)

    def arm(self) -> None:
        """Accept set-points from now on; the chambers stay vented until one comes."""
        self.armed = True
        self.reason = ""

    def vent(self, reason: str) -> None:
        """Drop the set-point, write zeros from the next pass on, and accept no set-point until `arm`.

        Args:
            reason: Why, for whoever tries to command it.
        """
        if self.armed:  # the first reason stays: later ones are often its consequences
            self.armed = False
            self.reason = reason
        self._drop()

    def acknowledge(self, seconds: float) -> None:
        """Clear the errors that the terminal keeps, in the passes of the next ``seconds``.

        Raises:
            InterlockError: The bank is armed; acknowledging interrupts regulation.
        """
        if self.armed:
            raise InterlockError(self._device, "is armed", "vent before you acknowledge its errors")
        self._acknowledge_until_ns = self._clock() + round(seconds * NANOSECONDS)

    def command(self, setpoint: Sequence[float], lifetime_s: float) -> None:
        """Put a set-point in force.

        Args:
            setpoint: Gauge pressure of each chamber [Pa].
            lifetime_s: After so long the chambers vent unless it is renewed [s].

        Raises:
            InterlockError: The bank is not armed.
            LimitError: A pressure or the lifetime is out of range; nothing changes.
        """
        if not self.armed:
            raise InterlockError(self._device, f"accepts no set-point: {self.reason}", "arm it first")
        limit_lifetime(self._device, lifetime_s, self.limits)
        check_setpoint(self._device, setpoint, self.limits.maximum)
        self._setpoint = tuple(float(pressure) for pressure in setpoint)
        self._deadline_ns = self._clock() + round(lifetime_s * NANOSECONDS)

    def plan(self, seconds: float) -> OutputWrite:
        """Decide what to write now.

        Args:
            seconds: Time since the last write that slew may use [s].
        """
        expired = self._setpoint is not None and self._clock() >= self._deadline_ns
        if expired:
            self._drop()  # zeros at once: the slew limit holds for set-points, not for venting
        if self._setpoint is not None:
            self._level = limit_step(self._device, self._setpoint, self._level, self.limits, seconds)
        counts = self.chambers.to_counts(self._level, self.limits.maximum)
        applied = self.chambers.to_pressures(counts)
        acknowledge = not self.armed and self._clock() < self._acknowledge_until_ns
        return OutputWrite(self._setpoint, applied, counts, expired, acknowledge)

    def _drop(self) -> None:
        self._setpoint = None
        # Also without a pass in between: a caller that arms and commands at once starts from zero.
        self._level = (0.0,) * len(self._level)
