"""The control tick: a fixed rate that skips and counts missed periods."""

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from typing import Self


@dataclass(frozen=True)
class Tick:
    """One pass of the control loop.

    Args:
        index: Number of the deadline since the start; skipped ones count.
        deadline_ns: Monotonic time of the newest deadline, for which it stands.
        drift_ns: How long after that deadline it came; less than an interval, since older ones are skipped.
        missed: Deadlines skipped just before it.
        late_ns: How late the loop came: the time since the first deadline that it had not taken.
    """

    index: int
    deadline_ns: int
    drift_ns: int
    missed: int
    late_ns: int


class TickSchedule:
    """Deadlines on a fixed grid; a late tick skips to the grid and never bursts to catch up.

    Args:
        start_ns: Monotonic time of deadline 0.
        interval_ns: Time between two deadlines.
    """

    def __init__(self, start_ns: int, interval_ns: int) -> None:
        self._start_ns = start_ns
        self._interval_ns = interval_ns
        self._next = 0

    @property
    def next_deadline_ns(self) -> int:
        """Monotonic time of the next deadline."""
        return self._start_ns + self._next * self._interval_ns

    def take(self, now_ns: int) -> Tick:
        """Return the newest deadline that has passed.

        Args:
            now_ns: Monotonic time, not before the next deadline.

        Returns:
            The tick; the deadlines between it and the last one taken count as missed.
        """
        due = max(self._next, (now_ns - self._start_ns) // self._interval_ns)
        deadline_ns = self._start_ns + due * self._interval_ns
        late_ns = now_ns - self.next_deadline_ns
        tick = Tick(due, deadline_ns, now_ns - deadline_ns, due - self._next, late_ns)
        self._next = due + 1
        return tick


class Ticker:
    """Ticks for the event loop, timed by a thread: ``asyncio.sleep`` rounds up to a millisecond.

    Args:
        interval_s: Time between two ticks.
        clock_ns: Monotonic clock.
    """

    def __init__(self, interval_s: float, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._interval_ns = round(interval_s * 1e9)
        self._clock_ns = clock_ns
        self._loop = asyncio.get_running_loop()
        self._due = asyncio.Event()
        self._taken = threading.Semaphore(0)
        self._stop = threading.Event()
        self._schedule = TickSchedule(clock_ns() + self._interval_ns, self._interval_ns)
        self._thread = threading.Thread(target=self._time, name="softarm-tick", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._taken.release()
        self._thread.join()

    def _time(self) -> None:
        while not self._stop.is_set():
            wait_ns = self._schedule.next_deadline_ns - self._clock_ns()
            if wait_ns > 0 and self._stop.wait(wait_ns * 1e-9):
                return
            self._loop.call_soon_threadsafe(self._due.set)
            self._taken.acquire()

    async def ticks(self) -> AsyncIterator[Tick]:
        """Yield ticks until the ticker is closed."""
        while True:
            await self._due.wait()
            self._due.clear()
            yield self._schedule.take(self._clock_ns())
            self._taken.release()
