"""What can go wrong with an instrument, and whether trying again can help."""

from collections.abc import Iterator, Sequence
from typing import ClassVar

Scalar = float | int | str | None


class DeviceError(Exception):
    """A failure of one device, described in one line.

    Args:
        device: The device, as the configuration names it.
        what: What is wrong.
        cure: What to do about it.
        value: The value at fault, where there is one.
        limit: What the value should have kept to.
        unit: The unit of value and limit.
    """

    retried: ClassVar[bool] = True

    def __init__(
        self,
        device: str,
        what: str,
        cure: str,
        *,
        value: Scalar = None,
        limit: Scalar = None,
        unit: str = "",
    ) -> None:
        self.device = device
        self.what = what
        self.cure = cure
        self.value = value
        self.limit = limit
        self.unit = unit
        super().__init__(f"{device}: {what}{_quantities(value, limit, unit)}; {cure}")


class ConfigurationError(DeviceError):
    """The configuration does not fit the device; trying again cannot help."""

    retried = False


class ConnectionLost(DeviceError):  # noqa: N818
    """The device does not answer, or no longer; the supervisor tries again."""


class ProtocolError(DeviceError):
    """The device answers, but not what its protocol allows; the supervisor reconnects."""


class LimitError(DeviceError):
    """A command requests more than the limits allow; nothing was written."""

    retried = False


class InterlockError(DeviceError):
    """A command came while the device may not move; nothing was written."""

    retried = False


class DeviceErrors(ExceptionGroup[DeviceError]):
    """All failures of one attempt, so that one run names every cure."""

    def derive(self, excs: Sequence[DeviceError]) -> "DeviceErrors":  # type: ignore[override]
        """Keep the type when the group is split; only device errors go in."""
        return DeviceErrors(self.message, excs)

    def leaves(self) -> Iterator[DeviceError]:
        """Iterate over the failures, whatever the nesting."""
        for error in self.exceptions:
            if isinstance(error, DeviceErrors):
                yield from error.leaves()
            elif isinstance(error, DeviceError):
                yield error

    def lines(self) -> list[str]:
        """Describe each failure in one line."""
        return [str(error) for error in self.leaves()]


def _quantities(value: Scalar, limit: Scalar, unit: str) -> str:
    suffix = f" {unit}" if unit else ""
    parts = [
        f"{name} {quantity}{suffix}"
        for name, quantity in (("value", value), ("limit", limit))
        if quantity is not None
    ]
    return f" ({', '.join(parts)})" if parts else ""
