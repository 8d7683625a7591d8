"""Virtual time for everything that waits, and the byte vectors of the manuals."""

import asyncio
import selectors
import tomllib
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

MAX_IDLE_SECONDS = 1e6


class VirtualSelector(selectors.DefaultSelector):
    """Never blocks: where the loop would wait, virtual time moves on."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 1000.0

    def select(self, timeout: float | None = None) -> list[Any]:
        events = super().select(0)
        if not events and timeout is None:
            raise RuntimeError("every task waits and nothing will ever wake one")
        if not events and timeout:
            self.now += timeout
            assert self.now < MAX_IDLE_SECONDS, "the test goes on for ever"
        return events


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop whose clock jumps to the next timer."""

    def __init__(self) -> None:
        self._virtual = VirtualSelector()
        super().__init__(self._virtual)

    def time(self) -> float:
        return self._virtual.now


class Virtual:
    """Runs a coroutine function in virtual time and demands that it leaves no task behind."""

    @staticmethod
    def clock() -> int:
        return round(asyncio.get_running_loop().time() * 1e9)

    @staticmethod
    def stall(seconds: float) -> None:
        """Let time pass while the loop stands still, as a busy host does."""
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualLoop)
        loop._virtual.now += seconds

    @staticmethod
    def run(main: Callable[[], Awaitable[Any]]) -> Any:
        async def checked() -> Any:
            result = await main()
            left = [task.get_name() for task in asyncio.all_tasks() if task is not asyncio.current_task()]
            assert not left, f"tasks left behind: {left}"
            return result

        with asyncio.Runner(loop_factory=VirtualLoop) as runner:
            return runner.run(checked())


@pytest.fixture(scope="session")
def virtual() -> Virtual:
    return Virtual()


@pytest.fixture(scope="session")
def vectors() -> dict[str, Any]:
    """Byte vectors of the manuals by device; see vectors.toml."""
    return tomllib.loads((Path(__file__).parent / "vectors.toml").read_text())
