"""The one clock of all fakes: seconds since they were started."""

import asyncio


class Clock:
    """The time of the running event loop: real time, or that of a loop that runs faster."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._start = self._loop.time()

    def restart(self) -> None:
        """Begin again at 0."""
        self._start = self._loop.time()

    def now(self) -> float:
        """Return the seconds since the clock was made or restarted."""
        return self._loop.time() - self._start

    async def sleep_until(self, time: float) -> None:
        """Return at ``time`` [s], or at once (after one pass of the loop) when it has passed."""
        await asyncio.sleep(max(0.0, time - self.now()))
