"""One sample of one device, with all that is needed to judge it."""

from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar

Value = TypeVar("Value")


class Reading(NamedTuple, Generic[Value]):
    """A sample with its times, its place in the stream and its validity.

    Attributes:
        device: The device, as the configuration names it.
        value: What was measured, in SI units; each driver documents its type.
        device_time_ns: Time on the device's own clock [ns]; None where it has none.
        host_monotonic_ns: Host monotonic time of arrival [ns].
        measured_ns: Best estimate of the host monotonic time of the measurement [ns];
            never later than the arrival.
        sequence: The device's own counter, or a count since the epoch began.
        epoch: Grows whenever device time and counter may have started again.
        valid: Whether the value may be used.
        source: Where it came from, such as ``modbus+tcp://192.168.0.100:502``;
            a fake device's begins with ``fake+``.
        flags: Why the value is invalid, or what is special about it.
    """

    device: str
    value: Value
    device_time_ns: int | None
    host_monotonic_ns: int
    measured_ns: int
    sequence: int
    epoch: int
    valid: bool
    source: str
    flags: tuple[str, ...] = ()


Sink = Callable[[Reading[Any]], None]
"""Receives readings as they come; it must return at once."""


def ignore(reading: Reading[Any]) -> None:
    """Ignore a reading: the sink of a device of which only the latest reading is used."""
