"""Keeps one device connected: one state, one task, capped waits between attempts."""

import asyncio
import contextlib
import logging
import re
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from random import Random
from typing import Protocol

from softarm.drivers.backoff import Backoff
from softarm.drivers.clock import NANOSECONDS, Clock, monotonic
from softarm.drivers.errors import ConnectionLost, DeviceError, ProtocolError
from softarm.drivers.health import Health
from softarm.drivers.tasks import finish

logger = logging.getLogger(__name__)

STALE = "stale"


class ConnectionState(StrEnum):
    """State of the connection to a device."""

    DISCONNECTED = "disconnected"
    CONNECTING = "connecting"
    IDENTIFY = "identify"
    STREAMING = "streaming"
    DEGRADED = "degraded"
    FAULT = "fault"


_ENDS = frozenset({ConnectionState.FAULT, ConnectionState.DISCONNECTED})
TRANSITIONS: dict[ConnectionState, frozenset[ConnectionState]] = {
    ConnectionState.DISCONNECTED: frozenset({ConnectionState.CONNECTING}),
    ConnectionState.CONNECTING: _ENDS | {ConnectionState.IDENTIFY},
    ConnectionState.IDENTIFY: _ENDS | {ConnectionState.STREAMING},
    ConnectionState.STREAMING: _ENDS | {ConnectionState.DEGRADED},
    ConnectionState.DEGRADED: _ENDS | {ConnectionState.STREAMING},
    ConnectionState.FAULT: frozenset({ConnectionState.CONNECTING, ConnectionState.DISCONNECTED}),
}
"""From each state to those that may follow. FAULT waits for the next attempt, or for good after a
configuration error; DISCONNECTED is before `start` and after `stop`."""

ALIVE = frozenset({ConnectionState.STREAMING, ConnectionState.DEGRADED})


class DeviceSession(Protocol):
    """One connection, from open to close."""

    async def identify(self) -> None:
        """Check that the peer is what the configuration names, and prepare it."""

    async def stream(self) -> None:
        """Exchange data until the connection is lost; raises the `DeviceError` that ended it."""

    async def close(self) -> None:
        """Leave the device safe and release the transport; called once, whatever went before."""


Opener = Callable[[], Awaitable[DeviceSession]]
Observer = Callable[[ConnectionState, ConnectionState], None]


@dataclass(frozen=True, slots=True)
class Timing:
    """Deadlines of one device.

    Attributes:
        stale_after_s: Without a valid reading for so long the device counts as degraded [s].
        lost_after_s: Without a sign of life for so long the connection counts as lost [s]; never when None.
        open_s: Time to open the transport [s].
        identify_s: Time to identify the device [s].
        close_s: Time to leave the device safe [s].
        stable_s: Streaming for so long makes the next waits start short again [s].
    """

    stale_after_s: float = 0.5
    lost_after_s: float | None = None
    open_s: float = 3.0
    identify_s: float = 5.0
    close_s: float = 1.0
    stable_s: float = 1.0


class Supervisor:
    """Opens sessions one after the other until stopped.

    Args:
        device: The device, as the configuration names it.
        open_session: Opens the transport; the only I/O outside a session.
        health: Counters and alarms; while an alarm stands the state is DEGRADED instead of STREAMING.
        timing: Deadlines.
        backoff: Waits between attempts.
        random: Source of the jitter.
        clock: Host monotonic time.
        observer: Called at each change of state, from and to.
    """

    def __init__(
        self,
        device: str,
        open_session: Opener,
        health: Health,
        *,
        timing: Timing | None = None,
        backoff: Backoff | None = None,
        random: Random | None = None,
        clock: Clock = monotonic,
        observer: Observer | None = None,
    ) -> None:
        self.device = device
        self.health = health
        self.timing = timing or Timing()
        self.backoff = backoff or Backoff()
        self.state = ConnectionState.DISCONNECTED
        self.error: DeviceError | None = None
        self._open_session = open_session
        self._random = random or Random()
        self._clock = clock
        self._observer = observer
        self._task: asyncio.Task[None] | None = None
        self._waiting: list[tuple[frozenset[ConnectionState], asyncio.Future[ConnectionState]]] = []
        self._last_reading_ns = self._valid_ns = 0
        self._failures_in_row = self._stops = 0
        health.alarms.observer = self._follow_alarms

    async def start(self) -> None:
        """Begin to connect and wait for the first outcome.

        Raises:
            DeviceError: The first attempt failed. Unless it was a configuration error,
                attempts go on until `stop`.
        """
        # The task that gave up still closes its session; two of them would share the transport.
        if self._task is not None and self.error is not None and not self.error.retried:
            stops = self._stops
            await asyncio.wait({self._task})
            if self._stops != stops:
                raise self._closed()
        if not self.retrying:
            self._enter(ConnectionState.CONNECTING)
            self._task = asyncio.create_task(self._run(), name=f"{self.device} supervisor")
        outcome = await self.wait_for(*ALIVE, ConnectionState.FAULT, ConnectionState.DISCONNECTED)
        if outcome is ConnectionState.FAULT and self.error is not None:
            raise self.error
        if outcome is ConnectionState.DISCONNECTED:
            raise self._closed()

    def _closed(self) -> ConnectionLost:
        return ConnectionLost(self.device, "was closed while it connected", "connect again")

    async def stop(self) -> None:
        """End the session, which leaves the device safe, and the attempts."""
        self._stops += 1
        task, self._task = self._task, None
        if task is not None:
            await finish(task, cancel=True)
        self._enter(ConnectionState.DISCONNECTED)
        self.health.alarms.clear_all()

    async def wait_for(self, *states: ConnectionState) -> ConnectionState:
        """Wait until one of these states is entered, or stands already."""
        if self.state in states:
            return self.state
        future: asyncio.Future[ConnectionState] = asyncio.get_running_loop().create_future()
        self._waiting.append((frozenset(states), future))
        return await future

    def reading_arrived(self, valid: bool = True) -> None:
        """Record a sign of life.

        Args:
            valid: Whether it was a valid reading, which also ends staleness.
        """
        self._last_reading_ns = self._clock()
        if valid:
            self._valid_ns = self._last_reading_ns
            self.health.alarms.clear(STALE)

    @property
    def retrying(self) -> bool:
        """Whether attempts go on."""
        return self._task is not None and not self._task.done()

    async def _run(self) -> None:
        delays = self.backoff.delays(self._random)
        while True:
            began_ns, connections = self._clock(), self.health.connections
            error = await self._attempt()
            streamed = self.health.connections > connections
            # A device that connects and fails at once must not be tried again at full rate.
            if streamed and self._clock() - began_ns > self.timing.stable_s * NANOSECONDS:
                delays = self.backoff.delays(self._random)
            if not error.retried:
                return
            await asyncio.sleep(next(delays))

    async def _attempt(self) -> DeviceError:
        """Run one session to its end and return what ended it."""
        try:
            session = await self._open()
        except Exception as raised:  # noqa: BLE001  the task runner: nothing else would report it
            return self._fail(raised)
        try:
            await self._use(session)
            return self._fail(ConnectionLost(self.device, "ended the connection", "check the device"))
        except Exception as raised:  # noqa: BLE001  the task runner: nothing else would report it
            return self._fail(raised)
        finally:
            await self._close(session)

    async def _open(self) -> DeviceSession:
        self._enter(ConnectionState.CONNECTING)
        with self._deadline("did not open", self.timing.open_s) as deadline:
            async with deadline:
                return await self._open_session()

    async def _use(self, session: DeviceSession) -> None:
        self._enter(ConnectionState.IDENTIFY)
        with self._deadline("did not identify itself", self.timing.identify_s) as deadline:
            async with deadline:
                await session.identify()
        self._begin_streaming()
        await self._stream(session)

    @contextlib.contextmanager
    def _deadline(self, what: str, seconds: float) -> Iterator[asyncio.Timeout]:
        deadline = asyncio.timeout(seconds)
        try:
            yield deadline
        except TimeoutError as error:
            cure = "check address, protocol and power"
            raise ConnectionLost(self.device, what, cure, limit=seconds, unit="s") from error

    def _begin_streaming(self) -> None:
        self._last_reading_ns = self._valid_ns = self._clock()  # silence counts from here
        self.health.connections += 1
        if self._failures_in_row:
            logger.info("%s: connected again after %d failed attempts", self.device, self._failures_in_row)
        self._failures_in_row = 0
        self.error = None
        self._enter(ConnectionState.STREAMING)
        self._follow_alarms()

    async def _stream(self, session: DeviceSession) -> None:
        tasks = [
            asyncio.create_task(session.stream(), name=f"{self.device} stream"),
            asyncio.create_task(self._watch(), name=f"{self.device} watch"),
        ]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in tasks:
                if task in done:
                    task.result()
        finally:
            await finish(*tasks, cancel=True)

    async def _watch(self) -> None:
        """Detect silence: degraded without valid readings, lost without any sign of life."""
        timing = self.timing
        lost_ns = None if timing.lost_after_s is None else round(timing.lost_after_s * NANOSECONDS)
        stale_ns = round(timing.stale_after_s * NANOSECONDS)
        while True:
            now_ns = self._clock()
            if lost_ns is not None and now_ns - self._last_reading_ns >= lost_ns:
                raise ConnectionLost(
                    self.device,
                    "stopped sending",
                    "check cable and power",
                    limit=timing.lost_after_s,
                    unit="s",
                )
            due_ns = self._valid_ns + stale_ns
            if now_ns >= due_ns:
                self._set_stale(now_ns)
                due_ns = now_ns + stale_ns
            if lost_ns is not None:
                due_ns = min(due_ns, self._last_reading_ns + lost_ns)
            # At least a millisecond: a reading that comes now moves the deadline, and the loop must not spin.
            await asyncio.sleep(max(due_ns - now_ns, 1_000_000) / NANOSECONDS)

    def _set_stale(self, now_ns: int) -> None:
        age_s = round((now_ns - self._valid_ns) / NANOSECONDS, 3)
        cure = "check that the device measures; for motion capture, that the markers are in view"
        limit = self.timing.stale_after_s
        self.health.alarms.set(STALE, "no valid reading", cure, value=age_s, limit=limit, unit="s")

    async def _close(self, session: DeviceSession) -> None:
        """Close a session to the end, even when cancelled: this is what leaves the device safe."""
        await finish(asyncio.create_task(self._close_in_time(session), name=f"{self.device} close"))

    async def _close_in_time(self, session: DeviceSession) -> None:
        try:
            async with asyncio.timeout(self.timing.close_s):
                await session.close()
        except (DeviceError, OSError, TimeoutError) as error:
            logger.warning("%s: did not close cleanly: %s", self.device, error or "no answer in time")

    def _fail(self, raised: Exception) -> DeviceError:
        error = self._explain(raised)
        self.error = self.health.last_error = error
        self.health.failures += 1
        self._failures_in_row += 1
        # A device that is switched off for a day would fill the log with the same line.
        level = logging.WARNING if self._failures_in_row == 1 or not error.retried else logging.DEBUG
        logger.log(level, "%s%s", error, "; will retry" if error.retried else "")
        # In this order: alarms that clear while the state is alive would make it STREAMING again.
        self._enter(ConnectionState.FAULT)
        self.health.alarms.clear_all()
        return error

    def _explain(self, raised: Exception) -> DeviceError:
        if isinstance(raised, DeviceError):
            return raised
        if isinstance(raised, OSError):
            cure = "check cable, address and power"
            return ConnectionLost(self.device, f"cannot be reached: {_reason(raised)}", cure)
        logger.error("%s: the driver failed", self.device, exc_info=raised)
        return ProtocolError(self.device, f"driver failed with {raised!r}", "report this with the log")

    def _follow_alarms(self) -> None:
        if self.state in ALIVE:
            self._enter(ConnectionState.DEGRADED if self.health.alarms else ConnectionState.STREAMING)

    def _enter(self, state: ConnectionState) -> None:
        before, self.state = self.state, state
        if before is state:
            return
        assert state in TRANSITIONS[before], f"{before} may not become {state}"
        for wanted, future in self._waiting:
            if state in wanted and not future.done():
                future.set_result(state)
        self._waiting = [entry for entry in self._waiting if not entry[1].done()]
        if self._observer is not None:
            self._observer(before, state)


def _reason(error: OSError) -> str:
    """Return what the system reports, without its number, which only programs read."""
    return re.sub(r"\[Errno -?\d+\] ", "", str(error)) or type(error).__name__
