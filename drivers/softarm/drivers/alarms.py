"""What is wrong with a device right now: a list of findings that clear themselves."""

from collections.abc import Callable
from dataclasses import dataclass

from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.errors import Scalar


@dataclass(frozen=True, slots=True)
class Alarm:
    """One thing that is wrong at present.

    Attributes:
        key: What it is about; one alarm stands per key.
        what: What is wrong, in words.
        cure: What to do about it.
        since_ns: Host monotonic time when it began [ns].
        value: The value at fault, where there is one.
        limit: What the value should keep to.
        unit: The unit of value and limit.
    """

    key: str
    what: str
    cure: str
    since_ns: int
    value: Scalar = None
    limit: Scalar = None
    unit: str = ""


class Alarms:
    """The alarms that stand, each with the time when it began."""

    def __init__(self, clock: Clock = monotonic) -> None:
        self._clock = clock
        self._standing: dict[str, Alarm] = {}
        self.observer: Callable[[], None] = _nothing

    def set(
        self,
        key: str,
        what: str,
        cure: str,
        *,
        value: Scalar = None,
        limit: Scalar = None,
        unit: str = "",
    ) -> bool:
        """Raise an alarm, or update its text.

        Args:
            key: Names the alarm, for ``clear``.
            what: What is wrong.
            cure: What to do about it.
            value: What was measured, where it is a quantity.
            limit: What would be right.
            unit: Unit of both.

        Returns:
            Whether it is new.
        """
        before = self._standing.get(key)
        since_ns = before.since_ns if before else self._clock()
        self._standing[key] = Alarm(key, what, cure, since_ns, value, limit, unit)
        if before is None:
            self.observer()
        return before is None

    def clear(self, key: str) -> None:
        """Clear an alarm, where it stands."""
        if self._standing.pop(key, None) is not None:
            self.observer()

    def clear_all(self) -> None:
        """Clear every alarm: the state of a device that is gone is unknown."""
        if self._standing:
            self._standing.clear()
            self.observer()

    @property
    def active(self) -> tuple[Alarm, ...]:
        """The alarms that stand, oldest first."""
        return tuple(self._standing.values())

    def __contains__(self, key: str) -> bool:
        return key in self._standing

    def __bool__(self) -> bool:
        return bool(self._standing)


def _nothing() -> None:
    pass
