"""Real sockets and terminals, accelerated time: a bench of fakes, drivers on it, and waiting for facts."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from acceptance.warp import WarpLoop
from softarm.drivers.registry import load_devices
from softarm.fakes.rig import Rig, running
from softarm.fakes.scenario import check_scenario

KERNEL_S = 0.5
"""Real time in which a busy kernel surely hands on what was written to a terminal."""
SPEED = 10.0


class Readings:
    """The sink of one driver: keeps readings and checks what must hold for every one of them."""

    def __init__(self) -> None:
        self.all: list[Any] = []

    def __call__(self, reading: Any) -> None:
        assert reading.measured_ns <= reading.host_monotonic_ns
        assert reading.source.startswith("fake+")
        if self.all:
            before = self.all[-1]
            assert reading.epoch >= before.epoch
            assert reading.host_monotonic_ns >= before.host_monotonic_ns
        self.all.append(reading)

    @property
    def last(self) -> Any:
        return self.all[-1]

    @property
    def valid(self) -> list[Any]:
        return [reading for reading in self.all if reading.valid]


class Wire:
    """Builds benches and drivers, and waits."""

    @staticmethod
    def clock() -> int:
        return round(asyncio.get_running_loop().time() * 1e9)

    @staticmethod
    def run(main: Callable[[], Awaitable[Any]], speed: float = SPEED) -> Any:
        """Run a coroutine function in accelerated time and demand that it leaves no task behind."""

        async def checked() -> Any:
            result = await main()
            left = [task.get_name() for task in asyncio.all_tasks() if task is not asyncio.current_task()]
            assert not left, f"tasks left behind: {left}"
            return result

        with asyncio.Runner(loop_factory=lambda: WarpLoop(speed)) as runner:
            return runner.run(checked())

    @staticmethod
    def bench(*devices: dict[str, Any], **keys: Any) -> Any:
        """Run fakes behind the arm without dynamics."""
        return running(check_scenario({"plant": {"kind": "still"}, "device": list(devices), **keys}))

    def driver(self, table: dict[str, Any], **options: Any) -> tuple[Any, Readings]:
        """Build a driver from its configuration."""
        (config,) = load_devices([{**table, "simulated": True}])
        readings = Readings()
        return config.build(readings, self.clock, **options), readings

    def session(
        self,
        body: Callable[[Rig, Any, Readings], Awaitable[None]],
        fake: dict[str, Any],
        table: dict[str, Any],
        *,
        speed: float,
        connect: bool = True,
        **keys: Any,
    ) -> None:
        """Run ``body(rig, driver, readings)`` on one fake device, with its driver connected if asked."""

        async def main() -> None:
            async with self.bench(fake, **keys) as rig:
                driver, readings = self.driver({"name": fake["name"], **_address(rig, fake["name"]), **table})
                if connect:
                    await driver.connect()
                    first = "valid" if fake["name"] in rig.qtm_servers else "all"
                    await self.until(lambda: getattr(readings, first), what="first reading")
                try:
                    await body(rig, driver, readings)
                finally:
                    await driver.close()

        self.run(main, speed)

    async def more(self, readings: Readings, count: int = 10) -> list[Any]:
        """Wait for more valid readings and return them."""
        had = len(readings.valid)
        await self.until(lambda: len(readings.valid) >= had + count, what=f"{count} more valid readings")
        return readings.valid[had:]

    @staticmethod
    async def until(fact: Callable[[], Any], within: float = 3.0, what: str = "") -> Any:
        """Wait in virtual time until a fact holds, and no less than the kernel may need."""
        deadline, kernel = asyncio.get_running_loop().time() + within, time.monotonic() + KERNEL_S
        while not (value := fact()):
            late = asyncio.get_running_loop().time() >= deadline and time.monotonic() >= kernel
            assert not late, f"not within {within} s: {what or fact}"
            await asyncio.sleep(0.002)
        return value

    @staticmethod
    def counts(rig: Rig, device: str) -> dict[str, int]:
        return rig.boards[device].counts


def _address(rig: Rig, name: str) -> dict[str, Any]:
    if name in rig.qtm_servers:
        return {"host": "127.0.0.1", "port": rig.qtm_servers[name].port}
    return {"port": str(rig.serial_ports[name].link)}


@pytest.fixture(scope="session")
def wire() -> Wire:
    return Wire()
