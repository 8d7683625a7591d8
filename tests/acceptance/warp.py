"""An event loop whose waits are shorter than they say: real sockets and terminals, accelerated time."""

import asyncio
import os
import selectors
import time
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any, TypeVar, TypeVarTuple

Arguments = TypeVarTuple("Arguments")
Result = TypeVar("Result")
TURN = 1e-9
SLEEP_S = 1e-3
"""A wait that is shorter is spun, yielding to others: the system would make it several times as long."""


class WarpSelector(selectors.SelectSelector):
    """Waits a fraction of what is asked for.

    Virtual time moves while the loop waits, and by a nanosecond per turn, so a slow or busy machine makes no
    deadline pass, and a timer that rounding has put a hair into the future comes due. What runs on a thread
    takes the time it takes: while anything does, waits last as long as they say.

    Args:
        speed: Virtual seconds per second of waiting.
    """

    def __init__(self, speed: float) -> None:
        super().__init__()
        self.now = 0.0
        self.threads = 0
        self._speed = speed

    def select(self, timeout: float | None = None) -> list[Any]:
        """Wait for events, or until the virtual time-out has passed."""
        self.now += TURN
        events = super().select(0)
        if events or (timeout is not None and timeout <= 0):
            return events
        begin = time.perf_counter()
        speed = 1.0 if self.threads else self._speed
        events = self._wait(begin, None if timeout is None else timeout / speed)
        passed = (time.perf_counter() - begin) * speed
        self.now += passed if timeout is None or (events and passed < timeout) else timeout
        return events

    def _wait(self, begin: float, seconds: float | None) -> list[Any]:
        if seconds is None or seconds > SLEEP_S:
            return super().select(seconds)
        while not (events := super().select(0)) and time.perf_counter() < begin + seconds:
            os.sched_yield()
        return events


class WarpLoop(asyncio.SelectorEventLoop):
    """An event loop in accelerated time; only for fakes and drivers that take their time from the loop.

    Args:
        speed: Virtual seconds per second of waiting.
    """

    def __init__(self, speed: float = 10.0) -> None:
        self._warp = WarpSelector(speed)
        super().__init__(self._warp)

    def time(self) -> float:
        """Return the virtual time [s]."""
        return self._warp.now

    def run_in_executor(
        self, executor: Executor | None, func: Callable[[*Arguments], Result], *args: *Arguments
    ) -> asyncio.Future[Result]:
        """Run a function on a thread, in real time."""
        future = super().run_in_executor(executor, func, *args)
        self._warp.threads += 1
        future.add_done_callback(self._thread_ended)
        return future

    def _thread_ended(self, _future: object) -> None:
        self._warp.threads -= 1
