"""The control tick: a fixed rate that skips and counts missed periods."""

import asyncio
import ctypes
import os
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Self

SECOND_NS = 1_000_000_000


@dataclass(frozen=True)
class Tick:
    """One pass of the control loop.

    Args:
        index: Number of the deadline since the start; skipped ones count.
        deadline_ns: Monotonic time of the newest deadline, for which it stands.
        drift_ns: How long after that deadline it came; less than an interval, since older ones are skipped.
        missed: Deadlines skipped just before it.
        late_ns: How late the loop came: the time since the first deadline that it had not served.
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

    def begin_tick(self, now_ns: int) -> Tick:
        """Return the newest deadline that has passed.

        Args:
            now_ns: Monotonic time, not before the next deadline.

        Returns:
            The tick; the deadlines between it and the last one served count as missed.
        """
        due = max(self._next, (now_ns - self._start_ns) // self._interval_ns)
        deadline_ns = self._start_ns + due * self._interval_ns
        late_ns = now_ns - self.next_deadline_ns
        tick = Tick(due, deadline_ns, now_ns - deadline_ns, due - self._next, late_ns)
        self._next = due + 1
        return tick


class Ticker:
    """Ticks for the event loop, timed by the kernel: ``asyncio.sleep`` rounds up to a millisecond.

    Use it as a context manager.

    Args:
        interval_s: Time between two ticks.
    """

    def __init__(self, interval_s: float) -> None:
        self._interval_ns = round(interval_s * 1e9)
        self._loop = asyncio.get_running_loop()
        self._due = asyncio.Event()  # one, however often the timer expires while the loop is busy

    def __enter__(self) -> Self:
        start_ns = time.monotonic_ns() + self._interval_ns
        self._schedule = TickSchedule(start_ns, self._interval_ns)
        self._timer = _periodic_timer(start_ns, self._interval_ns)
        self._loop.add_reader(self._timer, self._expire)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.remove_reader(self._timer)
        os.close(self._timer)

    def _expire(self) -> None:
        os.read(self._timer, 8)  # how often it expired; the schedule counts by the clock
        self._due.set()

    async def ticks(self) -> AsyncIterator[Tick]:
        """Yield ticks until the ticker is closed."""
        while True:
            await self._due.wait()
            self._due.clear()
            now_ns = time.monotonic_ns()
            if now_ns >= self._schedule.next_deadline_ns:  # else the last tick stood for this one as well
                yield self._schedule.begin_tick(now_ns)


class _Timer(ctypes.Structure):
    """Interval and first expiry, each in seconds and nanoseconds: ``struct itimerspec``."""

    _fields_ = [(name, ctypes.c_long) for name in ("every_s", "every_ns", "first_s", "first_ns")]


_libc = ctypes.CDLL(None, use_errno=True)
ABSOLUTE = 1


def _periodic_timer(start_ns: int, interval_ns: int) -> int:
    """Return a descriptor that is readable from each deadline on (timerfd_create(2)).

    Raises:
        OSError: The process can open no more descriptors.
    """
    descriptor = _libc.timerfd_create(time.CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC)
    times = _Timer(*divmod(interval_ns, SECOND_NS), *divmod(start_ns, SECOND_NS))
    if descriptor < 0 or _libc.timerfd_settime(descriptor, ABSOLUTE, ctypes.byref(times), None):
        number = ctypes.get_errno()
        raise OSError(number, f"no timer: {os.strerror(number)}")
    return int(descriptor)
