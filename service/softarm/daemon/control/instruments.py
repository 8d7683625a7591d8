"""Where readings come from and set-points go: the live devices, behind an interface that a replay shares."""

import logging
from collections.abc import Mapping
from typing import Literal, Protocol

import numpy as np

from softarm.daemon.config import Setup
from softarm.daemon.control.controller import ValveOutputs
from softarm.daemon.safety.observation import DeviceStatus
from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.device import Device, close_all, connect_all
from softarm.drivers.errors import DeviceErrors
from softarm.drivers.reading import Sink
from softarm.drivers.supervisor import ALIVE
from softarm.drivers.valves import ValveBank
from softarm.drivers.valves.alarms import DIAGNOSIS, FOREIGN_WRITER, WATCHDOG_FIRED
from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError

logger = logging.getLogger(__name__)
Source = Literal["live", "fake", "replay"]


class Instruments(Protocol):
    """The instruments of one arm."""

    @property
    def source(self) -> Source:
        """Whether readings are live, from fakes, or replayed."""

    @property
    def bank(self) -> str:
        """Name of the valve bank."""

    @property
    def valves(self) -> ValveOutputs:
        """Valves that receive the set-points."""

    @property
    def applied(self) -> Floats:
        """Gauge pressures last written [Pa], shape (chambers,)."""

    def valve_alarms(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return what ends every pressurised mode, and the warnings about the valves."""

    @property
    def expiries(self) -> int:
        """How often the valves vented because a set-point was not renewed in time."""

    def devices(self) -> tuple[DeviceStatus, ...]:
        """Return the status of each device other than the valve bank."""

    def troubles(self) -> Mapping[str, str]:
        """Return what each device, or channel of one, reports as wrong."""

    async def connect(self) -> None:
        """Connect; what does not answer is logged and tried again by itself."""

    async def reconnect(self, name: str) -> None:
        """Close a device and connect it again.

        Raises:
            KeyError: There is no such device.
            DeviceErrors: The first attempt failed.
        """

    async def close(self) -> None:
        """Leave every device safe."""


class LiveInstruments:
    """The devices of a configuration.

    Args:
        setup: The configuration.
        sink: Receives every reading.
        clock: Monotonic clock of the drivers.

    Raises:
        InputError: The configuration has no valve bank.
    """

    def __init__(self, setup: Setup, sink: Sink, clock: Clock = monotonic) -> None:
        self._devices = [device.build(sink, clock) for device in setup.devices]
        banks = [device for device in self._devices if isinstance(device, ValveBank)]
        if len(banks) != 1:
            cure = "configure one device of kind festo_mpa or festo_vtem"
            raise InputError(str(setup.path), f"{len(banks)} valve banks", cure)
        self._bank = banks[0]
        self._simulated = any(device.simulated for device in setup.devices)
        self._chambers = len(setup.specimen.chambers)
        self._stale_after_s = {device.name: device.stale_after_s for device in setup.devices}
        self._measured = {sensor.device for sensor in setup.config.sensors}

    @property
    def source(self) -> Source:
        """Whether the peers are fakes."""
        return "fake" if self._simulated else "live"

    @property
    def bank(self) -> str:
        """Name of the valve bank."""
        return self._bank.name

    @property
    def valves(self) -> ValveBank:
        """The valve bank."""
        return self._bank

    @property
    def applied(self) -> Floats:
        """Gauge pressures last written [Pa], shape (chambers,)."""
        latest = self._bank.latest
        return np.zeros(self._chambers) if latest is None else np.array(latest.value.applied)

    def valve_alarms(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the fatal alarms of the valve bank, and the others."""
        standing = self._bank.health.alarms.active
        alarms = [(_fatal(alarm.key), f"{alarm.what}; {alarm.cure}") for alarm in standing]
        return (
            tuple(text for fatal, text in alarms if fatal),
            tuple(text for fatal, text in alarms if not fatal),
        )

    @property
    def expiries(self) -> int:
        """How often the valves vented because a set-point was not renewed in time."""
        return self._bank.health.events["set-point expired"]

    def devices(self) -> tuple[DeviceStatus, ...]:
        """Return the status of each device, the bank's too where its driver has ended for good."""
        return tuple(
            self._status(device)
            for device in self._devices
            if device is not self._bank or device.gave_up or device.health.sink_errors
        )

    def _status(self, device: Device) -> DeviceStatus:
        error = device.failure
        return DeviceStatus(
            name=device.name,
            connected=device.state in ALIVE,
            gave_up=device.gave_up,
            error="" if error is None else error.what,
            cure="" if error is None else error.cure,
            deadline_s=self._stale_after_s[device.name],
            measured=device.name in self._measured,
            sink_errors=device.health.sink_errors,
        )

    async def reconnect(self, name: str) -> None:
        """Close a device and connect it again.

        Raises:
            KeyError: There is no such device.
            DeviceErrors: The first attempt failed.
        """
        device = {device.name: device for device in self._devices}[name]
        await device.close()
        await device.connect()

    def troubles(self) -> dict[str, str]:
        """Return the newest alarm of each device, and of each channel that one is about."""
        return {
            _place(device.name, alarm.key): f"{alarm.what}; {alarm.cure}"
            for device in self._devices
            for alarm in device.health.alarms.active
        }

    async def connect(self) -> None:
        """Connect side by side."""
        try:
            await connect_all(self._devices)
        except DeviceErrors as errors:  # the supervisors keep trying; the findings show what is missing
            for line in errors.lines():
                logger.warning("%s", line)

    async def close(self) -> None:
        """Vent and let go of every device."""
        await close_all(self._devices)


def _place(device: str, key: str) -> str:
    """Name the channel that an alarm is about, the device where it is about all of it."""
    _, _, channel = key.partition(":")
    return f"{device}/{channel}" if channel else device


def _fatal(key: str) -> bool:
    """Return whether an alarm of the valve bank ends every pressurised mode."""
    return key in (WATCHDOG_FIRED, FOREIGN_WRITER) or key.endswith((" tracking", DIAGNOSIS))
