"""What goes into a recording: every sample of every device, set-points, estimates, changes of mode."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from softarm.daemon.config import SensorSettings
from softarm.daemon.control.channels import ChannelReading
from softarm.daemon.control.readings import channel
from softarm.daemon.control.recorder import Document, Drawing, Recorder
from softarm.daemon.control.recorder import Sample as RecordedSample
from softarm.estimator.recording import BEND_SUFFIXES, POSE_SUFFIXES
from softarm.recordings.mcap_writer import RecordTimes, Topic
from softarm.recordings.scene import SCENE, surface_scene
from softarm_client.messages import Estimate, SectionPose

SHAPE_EVERY_NS = 500_000_000
"""How often viewers get the surface."""
NO_STD = (math.nan, math.nan, math.nan)
POSE_STD = ("x_std_m", "y_std_m", "z_std_m", "x_std_rad", "y_std_rad", "z_std_rad")
APART_NS = 1_000
"""Samples that arrived together are kept so far apart: in a recording time rises."""


class RecordedStreams:
    """Names the channels as the canonical columns do and hands every sample to the recorder.

    The time of a recording counts from its beginning.

    Args:
        sensors: Which channel is which measurement.
        valves: Name of the valve bank.
        base_body: Channel of the motion-capture body on the base, empty for none.
        chambers: Number of chambers.
        clock_ns: Monotonic clock.
        triangles: Triangles of the arm's surface; without them no surface is recorded.
    """

    def __init__(
        self,
        recorder: Recorder,
        sensors: Sequence[SensorSettings],
        valves: str,
        base_body: str,
        chambers: int,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        triangles: Sequence[tuple[int, int, int]] = (),
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
        self.triangles = triangles
        self._shaped_ns = -SHAPE_EVERY_NS

    def record_reading(self, reading: ChannelReading) -> None:
        """Record a reading of a channel."""
        place = self._topics.get(reading.device)
        if place is None or not self.recording:
            return
        topic, fields = place
        # An orientation of an inertial unit has the last four numbers of a pose.
        if len(fields) != len(reading.value):
            fields = POSE_SUFFIXES[-len(reading.value) :]
        measured_ns = self._after_last(topic, reading.measured_ns)
        stamp = RecordTimes(
            (measured_ns - self._start_ns) * 1e-9,
            reading.host_monotonic_ns,
            reading.measured_ns if reading.device_time_ns is None else reading.device_time_ns,
            reading.sequence % 2**32,
        )
        self._recorder.put(RecordedSample(Topic(topic, fields, reading.source), reading.value, stamp))

    def commanded(self, pressures: Sequence[float], now_ns: int) -> None:
        """Record the pressures applied at a tick."""
        self._put(Topic("pressures_cmd", self._pressures, "service"), tuple(pressures), now_ns)

    def estimated(self, values: Mapping[str, float], time_s: float) -> None:
        """Record an estimate."""
        topic = Topic("estimate", tuple(values), "service")
        self._put(topic, tuple(values.values()), self._after_last(topic.name, round(time_s * 1e9)))

    @property
    def shape_wanted(self) -> bool:
        """Whether a shape of the arm is due in the recording that is open."""
        due = self._clock_ns() - self._shaped_ns >= SHAPE_EVERY_NS
        return due and bool(self.triangles) and self.recording

    def shaped(self, nodes: NDArray[np.float32], time_s: float) -> None:
        """Record the surface of the arm for viewers, twice a second.

        Args:
            nodes: Nodes of the surface, shape (nodes, 4).
            time_s: Monotonic time of the readings [s].
        """
        time_ns = round(time_s * 1e9)
        if self.recording and self.triangles and time_ns - self._shaped_ns >= SHAPE_EVERY_NS:
            self._shaped_ns = time_ns
            surface = partial(surface_scene, nodes=nodes[:, :3], triangles=self.triangles)
            self._recorder.put(Drawing(SCENE, surface, self._stamp(time_ns)))

    def document(self, topic: str, content: Mapping[str, object]) -> None:
        """Record a change of mode, a command, a finding."""
        if self.recording:
            self._recorder.put(Document(topic, content, self._stamp(self._clock_ns())))

    @property
    def recording(self) -> bool:
        """Whether a recording is open; the time of each counts from its beginning."""
        start = self._recorder.start_clocks
        if start is not None:
            self._start_ns = start.monotonic_ns
        return start is not None

    def _put(self, topic: Topic, values: tuple[float, ...], now_ns: int) -> None:
        if self.recording:
            self._recorder.put(RecordedSample(topic, values, self._stamp(now_ns)))

    def _after_last(self, topic: str, time_ns: int) -> int:
        """Return a time, or one just after the last: one set of readings may be estimated twice."""
        self._last_ns[topic] = max(time_ns, self._last_ns.get(topic, 0) + APART_NS)
        return self._last_ns[topic]

    def _stamp(self, now_ns: int) -> RecordTimes:
        self._sequence += 1
        return RecordTimes((now_ns - self._start_ns) * 1e-9, now_ns, now_ns, self._sequence % 2**32)


def estimate_columns(estimate: Estimate, sections: Sequence[SectionPose]) -> dict[str, float]:
    """Name forces, poses and their standard deviations as the columns of a recording do.

    Args:
        estimate: The forces.
        sections: The poses.

    Returns:
        Name without ``estimate_`` to value; NaN where nothing is estimated.
    """
    columns: dict[str, float] = {}
    for load in estimate.loads:
        for index, axis in enumerate("xyz"):
            variance = load.covariance_n2[index][index]
            name = f"force_{load.section}_{axis}"
            columns[f"{name}_n"] = load.force_n[index]
            columns[f"{name}_std_n"] = math.nan if variance is None else math.sqrt(max(variance, 0.0))
    for pose in sections:
        values = (*pose.position_m, *pose.quaternion_wxyz)
        name = f"frame_{pose.section}"
        columns |= {f"{name}_{field}": value for field, value in zip(POSE_SUFFIXES, values, strict=True)}
        std = (*(pose.position_std_m or NO_STD), *(pose.rotation_std_rad or NO_STD))
        columns |= {f"{name}_{field}": value for field, value in zip(POSE_STD, std, strict=True)}
    return columns


def _place(sensor: SensorSettings) -> tuple[str, tuple[str, ...]]:
    match sensor.kind:
        case "pose" | "orientation":
            return f"frame/{sensor.section}", POSE_SUFFIXES
        case "bend":
            return f"bend/{sensor.section}", BEND_SUFFIXES
        case "gauge":
            return f"gauge/{sensor.section}", ("force_n",)
