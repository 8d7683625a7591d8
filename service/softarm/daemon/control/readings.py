"""The newest sample of every channel, and the readings that the estimator needs."""

import math
from collections.abc import Callable, Mapping, Sequence
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
        on_reading: Called with every reading of a channel as it comes.
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
        self._all = tuple((sensor, channel(sensor), f"{sensor.kind}_{sensor.section}") for sensor in sensors)
        self._sensors = tuple(entry for entry in self._all if entry[0].kind != "gauge")
        self._base_body = base_body
        self._deadline_s = safety.sensor_deadline_s
        self._deadlines_s = deadlines_s or {}
        self._on_reading = on_reading
        self._on_packet = on_packet
        self._leading = leading_channels(tuple(sensor for sensor, _, _ in self._sensors))
        self._latest: dict[str, ChannelReading] = {}
        self._device_ns: dict[str, int] = {}
        self._references: dict[str, Floats] = {}

    def on_reading(self, reading: Reading[Any]) -> None:
        """Store a reading of a driver; this is the drivers' sink."""
        for entry in channel_readings(reading):
            self.put(entry)

    def put(self, reading: ChannelReading) -> None:
        """Store a reading of a channel."""
        name = reading.device
        self._latest[name] = reading
        self._device_ns[name.split("/")[0]] = reading.host_monotonic_ns
        # The estimate before the recorder: recording is not urgent.
        if self._completes_packet(name):
            self._on_packet()
        self._on_reading(reading)

    def _completes_packet(self, name: str) -> bool:
        if name not in self._leading:
            return False
        # The channels of one packet share its arrival time to the nanosecond.
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
                label,
                sensor.needed,
                self.age_s(name, now_ns),
                self.deadline_s(name),
                troubles.get(name, troubles.get(sensor.device, "")),
            )
            for sensor, name, label in self._all
        )

    def rest(self, orientations: Mapping[str, Floats], now_ns: int) -> tuple[str, ...]:
        """Align inertial units with the model: the arm hangs at rest now.

        Args:
            orientations: Rotation of each section at rest in the base frame, shape (3, 3).
            now_ns: Monotonic time.

        Returns:
            Names of the units that were aligned; one that is silent is not.
        """
        aligned = []
        for sensor, name, _ in self._sensors:
            sample = self.fresh(name, now_ns)
            if sample is None or sensor.kind != "orientation":
                continue
            # A body of the motion capture may be an orientation too; it arrives as a pose and needs no rest.
            if len(sample.value) == READING_SIZE["orientation"]:
                measured = from_quaternions(np.array(sample.value))
                self._references[name] = orientations[sensor.section] @ measured.T
                aligned.append(name)
        return tuple(aligned)

    def snapshot(self, now_ns: int) -> Snapshot:
        """Return the fresh readings in the base frame."""
        base = self._latest.get(self._base_body)  # it does not move: an old reading is as good as a new one
        values: list[float] = []
        used, lost, times, arrivals = [], [], [], [0]
        for sensor, name, label in self._sensors:
            sample = self.fresh(name, now_ns)
            reading = None if sample is None else self._reading(sensor, sample, base)
            if reading is None or sample is None:
                values += (math.nan,) * READING_SIZE[sensor.kind]
                lost.append(label)
                continue
            values += reading
            used.append(label)
            times.append(sample.measured_ns)
            arrivals.append(sample.host_monotonic_ns)
        time_s = (sum(times) / len(times) if times else now_ns) * 1e-9
        return Snapshot(time_s, max(arrivals), np.array(values), tuple(used), tuple(lost))

    def _reading(
        self, sensor: SensorSettings, sample: ChannelReading, base: ChannelReading | None
    ) -> Sequence[float] | None:
        values = sample.value
        if sensor.kind == "bend":
            return values
        if len(values) == READING_SIZE["orientation"]:
            return self._inertial(sample)
        if self._base_body:
            if base is None:
                return None
            values = relative_pose(base.value, values)
        return values if sensor.kind == "pose" else values[3:]

    def _inertial(self, sample: ChannelReading) -> Sequence[float] | None:
        # Its yaw has an arbitrary zero, so it means nothing before it has been aligned at rest.
        reference = self._references.get(sample.device)
        if reference is None:
            return None
        aligned: list[float] = to_quaternions(reference @ from_quaternions(np.array(sample.value))).tolist()
        return aligned


def leading_channels(sensors: tuple[SensorSettings, ...]) -> tuple[str, ...]:
    """List the sensors' channels of the device that the first needed sensor belongs to, else the first."""
    if not sensors:
        return ()
    device = next((sensor.device for sensor in sensors if sensor.needed), sensors[0].device)
    return tuple(channel(sensor) for sensor in sensors if sensor.device == device)


def channel(sensor: SensorSettings) -> str:
    """Name the channel of a sensor."""
    return f"{sensor.device}/{sensor.channel}" if sensor.channel else sensor.device


def relative_pose(base: Sequence[float], pose: Sequence[float]) -> tuple[float, ...]:
    """Return a pose seen from the base: q = q_b* q_s, p = R_b^T (p_s - p_b).

    Args:
        base: Position [m] and quaternion of the base, 7 numbers; the quaternion may have any length but 0.
        pose: The same of the section.

    Returns:
        Position [m] and unit quaternion with w >= 0 in the base frame; NaN where a quaternion is 0.
    """
    x_b, y_b, z_b, a, b, c, d = base
    x, y, z = pose[0] - x_b, pose[1] - y_b, pose[2] - z_b
    e, f, g, h = pose[3:]
    quaternion = (
        a * e + b * f + c * g + d * h,
        a * f - b * e - c * h + d * g,
        a * g + b * h - c * e - d * f,
        a * h - b * g + c * f - d * e,
    )
    # Plain floats: for one pose numpy would spend its time on calls.
    length, square = math.hypot(*quaternion), a * a + b * b + c * c + d * d
    if length == 0.0:
        return (math.nan,) * 7
    # R_b^T v = v - 2 (a u x v - u x (u x v)) / |q_b|^2 with u = (b, c, d).
    u, v, w = c * z - d * y, d * x - b * z, b * y - c * x
    position = (
        x - 2.0 * (a * u - (c * w - d * v)) / square,
        y - 2.0 * (a * v - (d * u - b * w)) / square,
        z - 2.0 * (a * w - (b * v - c * u)) / square,
    )
    length = math.copysign(length, quaternion[0])
    return (*position, *(part / length for part in quaternion))
