"""The newest sample of every channel, and the readings that the estimator asks for."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from softarm.daemon.config import SafetySettings, SensorSettings
from softarm.daemon.control.channels import ChannelReading, channel_readings
from softarm.daemon.safety.observation import Input
from softarm.drivers.reading import Reading
from softarm.estimator.arrays import Floats
from softarm.estimator.rotations import from_quaternions, to_quaternions

READING_SIZE = {"pose": 7, "orientation": 4, "bend": 2}


@dataclass(frozen=True)
class Snapshot:
    """A time-aligned set of readings.

    Args:
        time_s: Mean measurement time of its readings [s], monotonic.
        newest_arrival_ns: Arrival of the newest reading in it, 0 when there is none.
        readings: Stacked readings in the base frame, NaN where absent, shape (readings,).
        used: Names of the sensors in it.
        lost: Names of the other sensors.
    """

    time_s: float
    newest_arrival_ns: int
    readings: Floats
    used: tuple[str, ...]
    lost: tuple[str, ...]


class Readings:
    """Keeps the newest sample of every channel.

    Args:
        sensors: Sensors in the order of the estimator's readings; gauges are ignored.
        base_body: Channel of the motion-capture body on the base, empty for none.
        safety: Default deadline of a channel.
        on_reading: Takes every reading of a channel as it comes.
        on_packet: Called when a packet of the leading device is complete: an estimate started then uses
            the newest readings.
        deadlines_s: Deadlines of channels that differ from the default [s].
    """

    def __init__(
        self,
        sensors: tuple[SensorSettings, ...],
        base_body: str,
        safety: SafetySettings,
        on_reading: Callable[[ChannelReading], None] = lambda _: None,
        on_packet: Callable[[], None] = lambda: None,
        deadlines_s: Mapping[str, float] | None = None,
    ) -> None:
        self._sensors = tuple(sensor for sensor in sensors if sensor.kind != "gauge")
        self._all = sensors
        self._base_body = base_body
        self._deadline_s = safety.sensor_deadline_s
        self._deadlines_s = deadlines_s or {}
        self._on_reading = on_reading
        self._on_packet = on_packet
        self._leading = leading_channels(self._sensors)
        self._latest: dict[str, ChannelReading] = {}
        self._device_ns: dict[str, int] = {}
        self._references: dict[str, Floats] = {}

    def take(self, reading: Reading[Any]) -> None:
        """Store a reading of a driver; this is the drivers' sink."""
        for entry in channel_readings(reading):
            self.put(entry)

    def put(self, reading: ChannelReading) -> None:
        """Store a reading of a channel."""
        name = reading.device
        self._latest[name] = reading
        self._device_ns[name.split("/")[0]] = reading.host_monotonic_ns
        if self._completes_packet(name):
            self._on_packet()
        self._on_reading(reading)

    def _completes_packet(self, name: str) -> bool:
        if name not in self._leading:
            return False
        arrivals = {self._latest[n].host_monotonic_ns if n in self._latest else None for n in self._leading}
        return len(arrivals) == 1

    def fresh(self, name: str, now_ns: int) -> ChannelReading | None:
        """Return the newest sample of a channel unless it is stale."""
        age_s = self.age_s(name, now_ns)
        return self._latest[name] if age_s is not None and age_s <= self.deadline_s(name) else None

    def deadline_s(self, name: str) -> float:
        """Return the age from which a channel's newest sample is stale [s]."""
        return self._deadlines_s.get(name, self._deadline_s)

    def device_age_s(self, device: str, now_ns: int) -> float | None:
        """Return the time since a device's last valid sample of any channel [s]."""
        last_ns = self._device_ns.get(device)
        return None if last_ns is None else max(now_ns - last_ns, 0) * 1e-9

    def age_s(self, name: str, now_ns: int) -> float | None:
        """Return the age of a channel's newest sample [s]."""
        sample = self._latest.get(name)
        return None if sample is None else max(now_ns - sample.measured_ns, 0) * 1e-9

    def inputs(self, now_ns: int, troubles: Mapping[str, str]) -> tuple[Input, ...]:
        """Return the state of every sensor for the health checks.

        Args:
            now_ns: Monotonic time.
            troubles: What is wrong with a device, or a channel of one.
        """
        return tuple(
            Input(
                f"{sensor.kind}_{sensor.section}",
                sensor.needed,
                self.age_s(channel(sensor), now_ns),
                self.deadline_s(channel(sensor)),
                troubles.get(channel(sensor), troubles.get(sensor.device, "")),
            )
            for sensor in self._all
        )

    def rest(self, orientations: Mapping[str, Floats]) -> tuple[str, ...]:
        """Align inertial units with the model: the arm hangs at rest now.

        Args:
            orientations: Rotation of each section at rest in the base frame, shape (3, 3).

        Returns:
            Names of the units that were aligned.
        """
        aligned = []
        for sensor in self._sensors:
            sample = self._latest.get(channel(sensor))
            if _is_inertial(sensor, sample) and sample is not None:
                measured = from_quaternions(np.array(sample.value))
                self._references[channel(sensor)] = orientations[sensor.section] @ measured.T
                aligned.append(channel(sensor))
        return tuple(aligned)

    def snapshot(self, now_ns: int) -> Snapshot:
        """Return the fresh readings in the base frame."""
        base = self._latest.get(self._base_body)  # it does not move: an old reading is as good as a new one
        parts, used, lost, times, arrivals = [], [], [], [], [0]
        for sensor in self._sensors:
            sample = self.fresh(channel(sensor), now_ns)
            reading = None if sample is None else self._reading(sensor, sample, base)
            name = f"{sensor.kind}_{sensor.section}"
            if reading is None or sample is None:
                parts.append(np.full(READING_SIZE[sensor.kind], np.nan))
                lost.append(name)
                continue
            parts.append(reading)
            used.append(name)
            times.append(sample.measured_ns)
            arrivals.append(sample.host_monotonic_ns)
        time_s = (sum(times) / len(times) if times else now_ns) * 1e-9
        return Snapshot(time_s, max(arrivals), np.concatenate(parts), tuple(used), tuple(lost))

    def _reading(
        self, sensor: SensorSettings, sample: ChannelReading, base: ChannelReading | None
    ) -> Floats | None:
        values = np.array(sample.value)
        if sensor.kind == "bend":
            return values
        if len(values) == READING_SIZE["orientation"]:
            return self._inertial(sensor, values)
        if self._base_body:
            if base is None:
                return None
            values = relative_pose(np.array(base.value), values)
        return values if sensor.kind == "pose" else values[3:]

    def _inertial(self, sensor: SensorSettings, quaternion: Floats) -> Floats | None:
        reference = self._references.get(channel(sensor))
        if reference is None:
            return None
        return to_quaternions(reference @ from_quaternions(quaternion))


def leading_channels(sensors: tuple[SensorSettings, ...]) -> tuple[str, ...]:
    """List the sensors' channels of the device that the first needed sensor belongs to, else the first."""
    if not sensors:
        return ()
    device = next((sensor.device for sensor in sensors if sensor.needed), sensors[0].device)
    return tuple(channel(sensor) for sensor in sensors if sensor.device == device)


def channel(sensor: SensorSettings) -> str:
    """Name the channel of a sensor."""
    return f"{sensor.device}/{sensor.channel}" if sensor.channel else sensor.device


def relative_pose(base: Floats, pose: Floats) -> Floats:
    """Return a pose seen from the base: R = R_b^T R_s, p = R_b^T (p_s - p_b).

    Args:
        base: Position [m] and quaternion of the base, shape (7,).
        pose: The same of the section, shape (7,).

    Returns:
        Position [m] and quaternion in the base frame, shape (7,).
    """
    rotation = from_quaternions(base[3:]).T
    quaternion = to_quaternions(rotation @ from_quaternions(pose[3:]))
    return np.concatenate([rotation @ (pose[:3] - base[:3]), quaternion])


def _is_inertial(sensor: SensorSettings, sample: ChannelReading | None) -> bool:
    return (
        sensor.kind == "orientation"
        and sample is not None
        and len(sample.value) == READING_SIZE["orientation"]
    )
