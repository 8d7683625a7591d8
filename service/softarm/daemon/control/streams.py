"""What goes into a recording: every sample of every device, set-points, estimates, changes of mode."""

import time
from collections.abc import Callable, Mapping, Sequence

from softarm.daemon.config import SensorSettings
from softarm.daemon.control.channels import ChannelReading
from softarm.daemon.control.readings import channel
from softarm.daemon.control.recorder import Document, Recorder
from softarm.daemon.control.recorder import Sample as RecordedSample
from softarm.estimator.recording import BEND_SUFFIXES, POSE_SUFFIXES
from softarm.recordings.mcap_writer import RecordTimes, TopicWriter

APART_NS = 1_000
"""Samples that arrived together are kept so far apart: in a recording time rises."""


class RecordedStreams:
    """Names the channels as the canonical columns do and hands every sample to the recorder.

    The time of a recording counts from its beginning.

    Args:
        recorder: The recorder.
        sensors: Which channel is which measurement.
        valves: Name of the valve bank.
        base_body: Channel of the motion-capture body on the base, empty for none.
        chambers: Number of chambers.
        clock_ns: Monotonic clock.
    """

    def __init__(
        self,
        recorder: Recorder,
        sensors: Sequence[SensorSettings],
        valves: str,
        base_body: str,
        chambers: int,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._recorder = recorder
        self._clock_ns = clock_ns
        self._pressures = tuple(f"chamber_{k}_pa" for k in range(chambers))
        self._topics = {valves: ("pressures", self._pressures)} | {
            channel(sensor): _place(sensor) for sensor in sensors
        }
        if base_body:
            self._topics[base_body] = ("frame/base", POSE_SUFFIXES)
        self._start_ns = 0
        self._last_ns: dict[str, int] = {}
        self._sequence = 0

    def take(self, reading: ChannelReading) -> None:
        """Record a reading of a channel."""
        place = self._topics.get(reading.device)
        if place is None or not self._recording():
            return
        topic, fields = place
        if len(fields) != len(reading.value):
            fields = POSE_SUFFIXES[-len(reading.value) :]
        measured_ns = self._after_last(topic, reading.measured_ns)
        stamp = RecordTimes(
            (measured_ns - self._start_ns) * 1e-9,
            reading.host_monotonic_ns,
            reading.measured_ns if reading.device_time_ns is None else reading.device_time_ns,
            reading.sequence % 2**32,
        )
        self._recorder.put(RecordedSample(TopicWriter(topic, fields, reading.source), reading.value, stamp))

    def commanded(self, pressures: Sequence[float], now_ns: int) -> None:
        """Record the pressures applied at a tick."""
        self._put(TopicWriter("pressures_cmd", self._pressures, "service"), tuple(pressures), now_ns)

    def estimated(self, values: Mapping[str, float], time_s: float) -> None:
        """Record an estimate."""
        stream = TopicWriter("estimate", tuple(values), "service")
        self._put(stream, tuple(values.values()), self._after_last(stream.topic, round(time_s * 1e9)))

    def document(self, topic: str, content: Mapping[str, object]) -> None:
        """Record a change of mode, a command, a finding."""
        if self._recording():
            self._recorder.put(Document(topic, content, self._stamp(self._clock_ns())))

    def _recording(self) -> bool:
        """Return whether a recording is open; the time of each counts from its beginning."""
        start = self._recorder.start_clocks
        if start is not None:
            self._start_ns = start.monotonic_ns
        return start is not None

    def _put(self, stream: TopicWriter, values: tuple[float, ...], now_ns: int) -> None:
        if self._recording():
            self._recorder.put(RecordedSample(stream, values, self._stamp(now_ns)))

    def _after_last(self, topic: str, time_ns: int) -> int:
        """Give a time, or one just after the last: one set of readings may be estimated twice."""
        self._last_ns[topic] = max(time_ns, self._last_ns.get(topic, 0) + APART_NS)
        return self._last_ns[topic]

    def _stamp(self, now_ns: int) -> RecordTimes:
        self._sequence += 1
        return RecordTimes((now_ns - self._start_ns) * 1e-9, now_ns, now_ns, self._sequence % 2**32)


def _place(sensor: SensorSettings) -> tuple[str, tuple[str, ...]]:
    match sensor.kind:
        case "pose" | "orientation":
            return f"frame/{sensor.section}", POSE_SUFFIXES
        case "bend":
            return f"bend/{sensor.section}", BEND_SUFFIXES
        case "gauge":
            return f"gauge/{sensor.section}", ("force_n",)
