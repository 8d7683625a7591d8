"""The readings of one device, numbered and timed."""

import logging
from collections.abc import Callable
from typing import Generic

from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.clock_map import ClockMap
from softarm.drivers.health import Health
from softarm.drivers.reading import Reading, Sink, Value, ignore

logger = logging.getLogger(__name__)


class ReadingStream(Generic[Value]):
    """Publishes the readings of one device and remembers the last one.

    Args:
        device: The device, as the configuration names it.
        source: Where the readings come from.
        health: Counters to keep.
        sink: Receives each reading; what it raises is counted and logged, never passed on.
        on_reading: Called after each reading with whether it was valid.
        clock: Host monotonic time.
    """

    def __init__(
        self,
        device: str,
        source: str,
        *,
        health: Health,
        sink: Sink = ignore,
        on_reading: Callable[[bool], object] = bool,
        clock: Clock = monotonic,
    ) -> None:
        self.device = device
        self.source = source
        self.clock_map = ClockMap()
        self.epoch = 0
        self.latest: Reading[Value] | None = None
        self._health = health
        self._sink = sink
        self._on_reading = on_reading
        self._clock = clock
        self._count = 0

    def start_epoch(self, reason: str) -> None:
        """Begin an epoch: device time and counter may start again from here.

        Args:
            reason: Why, for the counters, such as ``measurement restarted``.
        """
        self.epoch += 1
        self._count = 0
        self._health.events[reason] += 1

    def publish(
        self,
        value: Value,
        *,
        host_ns: int | None = None,
        device_time_ns: int | None = None,
        measured_ns: int | None = None,
        sequence: int | None = None,
        valid: bool = True,
        flags: tuple[str, ...] = (),
    ) -> Reading[Value]:
        """Publish one sample.

        Args:
            value: The sample, in SI units.
            host_ns: Host monotonic time of arrival [ns]; now when left out.
            device_time_ns: Device time [ns]; maps to the host clock by the fastest arrivals.
            measured_ns: Host monotonic time of the measurement [ns], where the driver knows it better.
            sequence: The device's own counter; counted on here when left out.
            valid: Whether the value may be used.
            flags: Why it is invalid, or what is special about it.

        Returns:
            The reading as the sink got it.
        """
        arrival_ns = self._clock() if host_ns is None else host_ns
        if measured_ns is None:
            measured_ns = (
                arrival_ns
                if device_time_ns is None
                else self.clock_map.update(device_time_ns, arrival_ns, self.epoch)
            )
        number = self._count if sequence is None else sequence
        reading = Reading(
            self.device,
            value,
            device_time_ns,
            arrival_ns,
            measured_ns,
            number,
            self.epoch,
            valid,
            self.source,
            flags,
        )
        # A sample without a counter, among others that have one, gets the next number, not an older one.
        self._count = number + 1
        self._remember(reading)
        self._pass_on(reading)
        return reading

    def _remember(self, reading: Reading[Value]) -> None:
        if self.latest is not None and self.latest.epoch == reading.epoch:
            self._health.interval.add(reading.host_monotonic_ns - self.latest.host_monotonic_ns)
        self._health.frames += 1
        self.latest = reading
        self._on_reading(reading.valid)

    def _pass_on(self, reading: Reading[Value]) -> None:
        try:
            self._sink(reading)
        except Exception:
            self._health.sink_errors += 1
            if self._health.sink_errors == 1:
                logger.exception("%s: the receiver of its readings failed", self.device)
