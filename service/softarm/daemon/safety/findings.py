"""Health findings: made by the checks at every tick, gone when they no longer hold."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from softarm.daemon.safety.observation import Observation

Severity = Literal["info", "warning", "fault"]


@dataclass(frozen=True)
class Finding:
    """Something a person should know; a fault also vents the arm.

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


Check = Callable[[Observation], Iterable[Finding]]


@dataclass(frozen=True)
class Standing:
    """A finding and since when it stands.

    Args:
        finding: The newest form of it.
        since_unix_ns: Wall clock at which it was first seen.
    """

    finding: Finding
    since_unix_ns: int


class FindingBook:
    """The findings that stand.

    Args:
        checks: Each makes its findings from an observation.
    """

    def __init__(self, checks: Iterable[Check]) -> None:
        self._checks = tuple(checks)
        self._standing: dict[tuple[str, str], Standing] = {}

    @property
    def standing(self) -> tuple[Standing, ...]:
        """Every finding that stands, oldest first."""
        return tuple(self._standing.values())

    def evaluate(self, observation: Observation) -> tuple[Finding, ...]:
        """Run every check on an observation without remembering anything."""
        return tuple(finding for check in self._checks for finding in check(observation))

    def faults(self, observation: Observation) -> tuple[Finding, ...]:
        """List what keeps the service out of the observation's mode."""
        return tuple(f for f in self.evaluate(observation) if f.severity == "fault")

    def update(
        self, observation: Observation, unix_ns: int
    ) -> tuple[tuple[Finding, ...], tuple[Finding, ...]]:
        """Run every check and remember the outcome.

        Args:
            observation: The service at this tick.
            unix_ns: Wall clock.

        Returns:
            Findings that are new, and those that cleared themselves.
        """
        before = self._standing
        now = {finding.key: finding for finding in self.evaluate(observation)}
        kept = {key: Standing(now[key], old.since_unix_ns) for key, old in before.items() if key in now}
        new = tuple(finding for key, finding in now.items() if key not in before)
        self._standing = kept | {finding.key: Standing(finding, unix_ns) for finding in new}
        cleared = tuple(old.finding for key, old in before.items() if key not in now)
        return new, cleared
