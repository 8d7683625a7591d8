"""Host time as the drivers see it, and a tick that keeps to it."""

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass

NANOSECONDS = 1_000_000_000

Clock = Callable[[], int]
"""Host monotonic time [ns]. Waiting goes through the event loop, so a loop with virtual
time and a clock that reads it make every test deterministic."""

monotonic: Clock = time.monotonic_ns


@dataclass(frozen=True, slots=True)
class PollTick:
    """One pass of a fixed-rate loop.

    Attributes:
        index: Count of periods since the start, the skipped ones included.
        drift_ns: How late the tick came [ns].
        skipped: Periods that were left out before this one because the loop overran.
    """

    index: int
    drift_ns: int
    skipped: int


class PollTicker:
    """Ticks at fixed monotonic times; an overrun skips ticks, it never bursts.

    Args:
        period_ns: Time between ticks [ns].
        clock: Host monotonic time.
    """

    def __init__(self, period_ns: int, clock: Clock = monotonic) -> None:
        self.period_ns = period_ns
        self.overruns = 0
        self._clock = clock
        self._start_ns = clock()
        self._index = 0

    async def wait(self) -> PollTick:
        """Wait for the next tick and return how late it came."""
        due = self._index + 1
        passed = (self._clock() - self._start_ns) // self.period_ns
        skipped = max(0, passed - due + 1) if passed >= due else 0
        self._index = due + skipped
        self.overruns += skipped
        due_ns = self._start_ns + self._index * self.period_ns
        await asyncio.sleep(max(0, due_ns - self._clock()) / NANOSECONDS)
        return PollTick(self._index, max(0, self._clock() - due_ns), skipped)
