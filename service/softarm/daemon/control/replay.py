"""A recording in place of the instruments: the same readings, at any speed, and nothing that moves."""

import asyncio
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Literal

import numpy as np

from softarm.daemon.config import SensorSettings
from softarm.daemon.control.channels import ChannelReading
from softarm.daemon.control.readings import channel
from softarm.daemon.safety.observation import DeviceStatus
from softarm.drivers.errors import InterlockError
from softarm.drivers.reading import Reading
from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording

BANK = "replay"


class ReplayedValves:
    """Valves that never move: a replay commands nothing."""

    armed = False

    def arm(self) -> None:
        """Refuse.

        Raises:
            InterlockError: Always.
        """
        raise InterlockError(BANK, "a recording is being replayed", "start the service without --replay")

    def vent(self, reason: str) -> None:
        """Do nothing: no pressure is applied."""

    def acknowledge(self) -> bool:
        """Return False: there are no errors to clear."""
        return False

    def command(self, setpoint: Sequence[float], lifetime_s: float) -> None:  # noqa: ARG002
        """Refuse.

        Raises:
            InterlockError: Always.
        """
        self.arm()


class ReplayedInstruments:
    """Plays a recording into the readings.

    Args:
        recording: What to play.
        sensors: Which measurement is which channel.
        chambers: Number of chambers.
        speed: Factor on the recorded time.
        put: Receives each reading of a channel.
        finished: Called at the end.

    Raises:
        InputError: The recording has nothing that a sensor of the configuration measures.
    """

    source: Literal["replay"] = "replay"
    bank = BANK

    def __init__(
        self,
        recording: Recording,
        sensors: Sequence[SensorSettings],
        chambers: int,
        speed: float,
        put: Callable[[ChannelReading], None],
        finished: Callable[[], None],
    ) -> None:
        self.valves = ReplayedValves()
        self._chambers = chambers
        self._put = put
        self._speed = speed
        self._time = recording.time
        self._finished = finished
        self._tracks = dict(_tracks(recording, sensors, chambers))
        if set(self._tracks) <= {BANK}:
            listed = ", ".join(f"{sensor.kind} of {sensor.section}" for sensor in sensors)
            raise InputError(recording.name, f"has none of {listed}", "configure [[sensors]] that it has")

    @property
    def applied(self) -> Floats:
        """Nothing is applied, shape (chambers,)."""
        return np.zeros(self._chambers)

    def valve_alarms(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return no alarms: a recording raises none."""
        return (), ()

    expiries = 0

    def devices(self) -> tuple[DeviceStatus, ...]:
        """Return no devices: a recording has none."""
        return ()

    async def reconnect(self, name: str) -> None:
        """Refuse: a recording has no devices.

        Raises:
            KeyError: Always.
        """
        raise KeyError(name)

    def troubles(self) -> dict[str, str]:
        """Return no troubles: a recording raises none."""
        return {}

    async def connect(self) -> None:
        """Play the recording to its end."""
        begin = time.monotonic()
        for index, at in enumerate((self._time - self._time[0]) / self._speed):
            # From the beginning, not from the last row: lateness must not add up.
            wait_s = begin + float(at) - time.monotonic()
            if wait_s > 0.0:
                await asyncio.sleep(wait_s)
            self._play(index)
        self._finished()

    def _play(self, index: int) -> None:
        now_ns = time.monotonic_ns()
        device_ns = round(float(self._time[index]) * 1e9)
        for name, values in self._tracks.items():
            row = values[index]
            if np.isfinite(row).all():
                numbers = tuple(float(value) for value in row)
                self._put(Reading(name, numbers, device_ns, now_ns, now_ns, index, 0, True, "replay"))

    async def close(self) -> None:
        """Do nothing: no device is open."""


def _tracks(
    recording: Recording, sensors: Sequence[SensorSettings], chambers: int
) -> Iterator[tuple[str, Floats]]:
    if set(range(chambers)) <= set(recording.chambers):
        yield BANK, np.column_stack([recording.pressure(k)[0] for k in range(chambers)])
    for sensor in sensors:
        match sensor.kind:
            case "pose" | "orientation" if sensor.section in recording.frames:
                yield channel(sensor), recording.pose(sensor.section)
            case "bend" if sensor.section in recording.bends:
                yield channel(sensor), recording.bend(sensor.section)
            case "gauge" if sensor.section in recording.gauges:
                yield channel(sensor), recording.gauge(sensor.section)[:, None]
            case _:
                continue
    if "base" in recording.frames:
        yield "base", recording.pose("base")
