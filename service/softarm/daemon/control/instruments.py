"""Where readings come from and set-points go: the live devices, behind a seam that a replay fills as well."""

import logging
from collections.abc import Mapping
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from softarm.daemon.config import Setup
from softarm.daemon.control.controller import ValveOutputs
from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.device import close_all, connect_all
from softarm.drivers.errors import DeviceErrors
from softarm.drivers.reading import Sink
from softarm.drivers.valves import ValveBank
from softarm.drivers.valves.alarms import DIAGNOSIS, FOREIGN_WRITER, WATCHDOG_FIRED
from softarm.estimator.errors import InputError

logger = logging.getLogger(__name__)
Floats = NDArray[np.float64]
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
        """Takes the set-points."""

    @property
    def applied(self) -> Floats:
        """Gauge pressures last written [Pa], shape (chambers,)."""

    def valve_alarms(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Tell what ends every pressurised mode, and what a person should know of the valves."""

    def troubles(self) -> Mapping[str, str]:
        """Tell what each device, or channel of one, says is wrong."""

    async def connect(self) -> None:
        """Connect; what does not answer is logged and tried again by itself."""

    async def close(self) -> None:
        """Leave every device safe."""


class LiveInstruments:
    """The devices of a configuration.

    Args:
        setup: The configuration.
        sink: Takes every reading.
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
        """Sort the valve bank's alarms."""
        standing = self._bank.health.alarms.standing
        told = [(_fatal(alarm.key), f"{alarm.what}; {alarm.cure}") for alarm in standing]
        return (
            tuple(text for fatal, text in told if fatal),
            tuple(text for fatal, text in told if not fatal),
        )

    def troubles(self) -> dict[str, str]:
        """Tell the newest alarm of each device, and of each channel that one is about."""
        return {
            _place(device.name, alarm.key): f"{alarm.what}; {alarm.cure}"
            for device in self._devices
            for alarm in device.health.alarms.standing
        }

    async def connect(self) -> None:
        """Connect side by side."""
        try:
            await connect_all(self._devices)
        except DeviceErrors as errors:
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
    """Tell whether an alarm of the valve bank ends every pressurised mode."""
    return key in (WATCHDOG_FIRED, FOREIGN_WRITER) or key.endswith((" tracking", DIAGNOSIS))
