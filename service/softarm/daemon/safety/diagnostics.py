"""Health findings: made by the checks at every tick, published with hysteresis."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from softarm.daemon.safety.observation import ServiceHealth

Severity = Literal["info", "warning", "fault"]
CLEAR_AFTER_NS = 2_000_000_000
"""A finding stands until it has been gone for so long: one that comes and goes is reported once."""


@dataclass(frozen=True)
class Diagnostic:
    """A condition that a person should know of; a fault also vents the arm.

    Args:
        code: Stable name.
        where: Device, stream or process.
        severity: ``fault`` when the mode cannot go on.
        message: What is wrong.
        hint: What to do.
    """

    code: str
    where: str
    severity: Severity
    message: str
    hint: str

    @property
    def key(self) -> tuple[str, str]:
        """What makes it the same finding as a tick ago."""
        return self.code, self.where


Check = Callable[[ServiceHealth], Iterable[Diagnostic]]


@dataclass(frozen=True)
class ActiveAlarm:
    """A finding and since when it stands.

    Args:
        finding: The newest form of it.
        since_unix_ns: Wall clock at which it was first seen.
        seen_ns: Monotonic time at which it was last seen.
    """

    finding: Diagnostic
    since_unix_ns: int
    seen_ns: int


class HealthMonitor:
    """The findings that stand.

    Args:
        checks: Each makes its findings from an observation.
        clear_after_ns: How long a finding must be gone before it counts as cleared.
    """

    def __init__(self, checks: Iterable[Check], clear_after_ns: int = CLEAR_AFTER_NS) -> None:
        self._checks = tuple(checks)
        self._clear_after_ns = clear_after_ns
        self._standing: dict[tuple[str, str], ActiveAlarm] = {}
        self._present: tuple[Diagnostic, ...] = ()

    @property
    def active(self) -> tuple[ActiveAlarm, ...]:
        """Every finding that stands, oldest first."""
        return tuple(self._standing.values())

    @property
    def present_faults(self) -> tuple[Diagnostic, ...]:
        """Faults of the newest observation, without hysteresis: they decide what happens to the arm."""
        return tuple(finding for finding in self._present if finding.severity == "fault")

    def evaluate(self, observation: ServiceHealth) -> tuple[Diagnostic, ...]:
        """Run every check on an observation without remembering anything."""
        return tuple(finding for check in self._checks for finding in check(observation))

    def faults(self, observation: ServiceHealth) -> tuple[Diagnostic, ...]:
        """List what keeps the service out of the observation's mode."""
        return tuple(f for f in self.evaluate(observation) if f.severity == "fault")

    def update(
        self, observation: ServiceHealth, now_ns: int, unix_ns: int
    ) -> tuple[tuple[Diagnostic, ...], tuple[Diagnostic, ...]]:
        """Run every check and remember the outcome.

        Args:
            observation: The service at this tick.
            now_ns: Monotonic time.
            unix_ns: Wall clock.

        Returns:
            Findings that are new, and those that have been gone for long enough to count as cleared.
        """
        self._present = self.evaluate(observation)
        new = []
        for finding in self._present:
            # Its text changes from tick to tick (an age grows), so the key alone identifies it.
            before = self._standing.get(finding.key)
            since_unix_ns = unix_ns if before is None else before.since_unix_ns
            self._standing[finding.key] = ActiveAlarm(finding, since_unix_ns, now_ns)
            if before is None:
                new.append(finding)
        gone = [key for key, old in self._standing.items() if now_ns - old.seen_ns > self._clear_after_ns]
        return tuple(new), tuple(self._standing.pop(key).finding for key in gone)
