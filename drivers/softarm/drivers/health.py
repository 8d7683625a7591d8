"""Counters of one device: what arrived, what was refused, how long answers took."""

from collections import Counter
from dataclasses import dataclass, field, fields
from typing import Any

from softarm.drivers.alarms import Alarms
from softarm.drivers.errors import DeviceError

SUB_BITS = 3
SUB_BINS = 1 << SUB_BITS
BINS = SUB_BINS * 48


class Histogram:
    """Counts of durations, eight bins to the octave, from a nanosecond to days."""

    __slots__ = ("_counts", "count", "largest_ns", "total_ns")

    def __init__(self) -> None:
        self._counts = [0] * BINS
        self.count = 0
        self.total_ns = 0
        self.largest_ns = 0

    def add(self, duration_ns: int) -> None:
        """Count one duration [ns]; a negative one counts as zero."""
        duration_ns = max(duration_ns, 0)
        self._counts[_bin(duration_ns)] += 1
        self.count += 1
        self.total_ns += duration_ns
        self.largest_ns = max(self.largest_ns, duration_ns)

    def quantile_ns(self, fraction: float) -> int:
        """Return the duration [ns] that this fraction does not exceed, to one bin; 0 when empty."""
        wanted = fraction * self.count
        passed = 0
        for index, count in enumerate(self._counts):
            passed += count
            if count and passed >= wanted:
                return min(_upper_edge(index), self.largest_ns)
        return 0

    @property
    def mean_ns(self) -> float:
        """Mean duration [ns]; 0 when empty."""
        return self.total_ns / self.count if self.count else 0.0

    def summary(self) -> dict[str, float]:
        """Sum up in microseconds, for people."""
        return {
            "count": self.count,
            "mean_us": self.mean_ns / 1e3,
            "p50_us": self.quantile_ns(0.50) / 1e3,
            "p99_us": self.quantile_ns(0.99) / 1e3,
            "max_us": self.largest_ns / 1e3,
        }


def _bin(duration_ns: int) -> int:
    # The leading bits are the bin, as in a short floating-point number: no logarithm, no rounding.
    shift = duration_ns.bit_length() - SUB_BITS - 1
    if shift <= 0:
        return duration_ns
    return min(((shift + 1) << SUB_BITS) + (duration_ns >> shift) - SUB_BINS, BINS - 1)


def _upper_edge(index: int) -> int:
    if index < 2 * SUB_BINS:
        return index
    shift = (index >> SUB_BITS) - 1
    return ((SUB_BINS + (index & (SUB_BINS - 1)) + 1) << shift) - 1


@dataclass(slots=True)
class Health:
    """Counters since the device was built; they only grow.

    Attributes:
        frames: Complete frames that passed every check.
        bad_checksum: Frames with a wrong checksum.
        malformed: Frames or lines that break the format.
        resyncs: Times the decoder had to search for the next frame.
        gaps: Samples that the device counted and the host never saw.
        rejected: Well-formed answers or commands that were refused: too short, foreign, out of range.
        timeouts: Requests without an answer in time.
        connections: Times streaming began.
        failures: Failed attempts and lost connections.
        sink_errors: Readings whose receiver raised.
        overruns: Polls skipped because one before them took too long.
        round_trip: Time from request to answer.
        interval: Time between readings; its spread is the jitter.
        drift: Lateness of the driver's own ticks.
        events: Counts of what is neither fault nor sample: a restarted measurement, a changed unit.
        facts: What the device reported of itself when it was identified.
        alarms: What is wrong at present.
        last_error: The last failure.
    """

    alarms: Alarms = field(default_factory=Alarms)
    frames: int = 0
    bad_checksum: int = 0
    malformed: int = 0
    resyncs: int = 0
    gaps: int = 0
    rejected: int = 0
    timeouts: int = 0
    connections: int = 0
    failures: int = 0
    sink_errors: int = 0
    overruns: int = 0
    round_trip: Histogram = field(default_factory=Histogram)
    interval: Histogram = field(default_factory=Histogram)
    drift: Histogram = field(default_factory=Histogram)
    events: Counter[str] = field(default_factory=Counter)
    facts: dict[str, str] = field(default_factory=dict)
    last_error: DeviceError | None = None

    @property
    def reconnects(self) -> int:
        """Times the device came back."""
        return max(0, self.connections - 1)

    def summary(self) -> dict[str, Any]:
        """Sum up as plain values that JSON can hold."""
        return {
            **{name: getattr(self, name) for name in COUNTERS},
            "reconnects": self.reconnects,
            "round_trip": self.round_trip.summary(),
            "interval": self.interval.summary(),
            "drift": self.drift.summary(),
            "events": dict(self.events),
            "facts": dict(self.facts),
            "alarms": [
                {"key": alarm.key, "what": alarm.what, "cure": alarm.cure} for alarm in self.alarms.active
            ],
            "last_error": str(self.last_error) if self.last_error else None,
        }


COUNTERS = tuple(one.name for one in fields(Health) if one.type is int)
