"""Counters of one device: what arrived, what was refused, how long answers took."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from softarm.drivers.alarms import Alarms
from softarm.drivers.errors import DeviceError
from softarm.drivers.histogram import Histogram


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
            "round_trip": dict(self.round_trip.summary()),
            "interval": dict(self.interval.summary()),
            "drift": dict(self.drift.summary()),
            "events": dict(self.events),
            "facts": dict(self.facts),
            "alarms": [
                {"key": alarm.key, "what": alarm.what, "cure": alarm.cure} for alarm in self.alarms.standing
            ],
            "last_error": str(self.last_error) if self.last_error else None,
        }


COUNTERS = (
    "frames",
    "bad_checksum",
    "malformed",
    "resyncs",
    "gaps",
    "rejected",
    "timeouts",
    "connections",
    "failures",
    "sink_errors",
    "overruns",
)
