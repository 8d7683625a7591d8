"""Devices: building one does nothing, `connect` is the only I/O entry, `close` leaves it safe."""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Iterable
from random import Random
from typing import Any

from softarm.drivers.alarms import Alarms
from softarm.drivers.backoff import Backoff
from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.errors import DeviceError, DeviceErrors
from softarm.drivers.health import Health
from softarm.drivers.reading import Sink
from softarm.drivers.stream import ReadingStream
from softarm.drivers.supervisor import ALIVE, ConnectionState, DeviceSession, Supervisor, Timing


class Device(ABC):
    """A device whose sessions a supervisor keeps alive; a driver implements `open`.

    Args:
        name: Name of the device in readings, errors and logs.
        source: Where its readings come from.
        timing: Deadlines.
        clock: Host monotonic time.
        backoff: Waits between attempts.
        random: Source of their jitter.
    """

    def __init__(
        self,
        name: str,
        source: str,
        *,
        timing: Timing,
        clock: Clock = monotonic,
        backoff: Backoff | None = None,
        random: Random | None = None,
    ) -> None:
        self.name = name
        self.source = source
        self.clock = clock
        self.timing = timing
        self.health = Health(Alarms(clock))
        self.supervisor = Supervisor(
            name,
            self.open,
            self.health,
            timing=timing,
            backoff=backoff,
            random=random,
            clock=clock,
            observer=self.on_state,
        )

    def reading_stream(self, sink: Sink) -> ReadingStream[Any]:
        """Return a stream of the readings that keeps the health and reports to the supervisor."""
        return ReadingStream(
            self.name,
            self.source,
            health=self.health,
            sink=sink,
            on_reading=self.supervisor.reading_arrived,
            clock=self.clock,
        )

    @abstractmethod
    async def open(self) -> DeviceSession:
        """Open the transport and return the session on it."""

    def on_state(self, before: ConnectionState, after: ConnectionState) -> None:  # noqa: B027  optional in a driver
        """Follow a change of state; the driver may act on it."""

    @property
    def state(self) -> ConnectionState:
        """Where the device stands."""
        return self.supervisor.state

    @property
    def failure(self) -> DeviceError | None:
        """Why it is not connected, ``None`` while it is or was not tried yet."""
        return None if self.state in ALIVE else self.supervisor.error

    @property
    def gave_up(self) -> bool:
        """Whether it is not connected and no further attempt is made."""
        return self.failure is not None and not self.failure.retried

    async def connect(self) -> None:
        """Open, identify and start streaming.

        Raises:
            DeviceErrors: The first attempt failed. Unless it was a configuration error, attempts go on
                until `close`.
        """
        try:
            await self.supervisor.start()
        except DeviceError as error:
            raise DeviceErrors(f"{self.name} is not connected", [error]) from None

    async def close(self) -> None:
        """Leave the device safe and let it go."""
        await self.supervisor.stop()


async def connect_all(devices: Iterable[Device]) -> None:
    """Connect devices side by side.

    Raises:
        DeviceErrors: One entry for each device that is not connected; the others are.
    """
    outcomes = await asyncio.gather(*(device.connect() for device in devices), return_exceptions=True)
    failures: list[DeviceError] = []
    for outcome in outcomes:
        if isinstance(outcome, DeviceErrors):
            failures.extend(outcome.leaves())
        elif isinstance(outcome, BaseException):
            raise outcome
    if failures:
        raise DeviceErrors(f"{len(failures)} of {len(outcomes)} devices are not connected", failures)


async def close_all(devices: Iterable[Device]) -> None:
    """Close devices side by side; each is closed even if another fails to."""
    outcomes = await asyncio.gather(*(device.close() for device in devices), return_exceptions=True)
    for outcome in outcomes:  # only now: an error must not leave another device under pressure
        if isinstance(outcome, BaseException):
            raise outcome
