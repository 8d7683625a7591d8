"""An event loop whose waits are shorter than they say: real sockets and terminals, accelerated time."""

import asyncio
import os
import selectors
import time
from typing import Any

TURN = 1e-9
SLEEP_S = 1e-3
"""A wait that is shorter is spun, yielding to others: the system would make it several times as long."""


class WarpSelector(selectors.SelectSelector):
    """Waits a fraction of what is asked for.

    Virtual time moves while the loop waits, and by a nanosecond per turn, so a slow or busy machine makes no
    deadline pass, and a timer that rounding has put a hair into the future comes due.

    Args:
        speed: Virtual seconds per second of waiting.
    """

    def __init__(self, speed: float) -> None:
        super().__init__()
        self.now = 0.0
        self._speed = speed

    def select(self, timeout: float | None = None) -> list[Any]:
        """Wait for events, or until the virtual time-out has passed."""
        self.now += TURN
        events = super().select(0)
        if events or (timeout is not None and timeout <= 0):
            return events
        begin = time.perf_counter()
        events = self._wait(begin, None if timeout is None else timeout / self._speed)
        passed = (time.perf_counter() - begin) * self._speed
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
