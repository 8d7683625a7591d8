"""Drivers against the fakes in a process of their own: rates, round trips, and how fast they come back."""

import asyncio
import contextlib
import json
import socket
import sys
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import tomli_w

from softarm.common.tables import Cell
from softarm.drivers.clock import NANOSECONDS
from softarm.drivers.device import Device, close_all, connect_all
from softarm.drivers.errors import DeviceErrors
from softarm.drivers.health import Histogram
from softarm.drivers.reading import Reading, ignore
from softarm.drivers.registry import KINDS, load_devices
from softarm.drivers.supervisor import ALIVE

OUTAGE_S = 0.5
PATIENCE_S = 30.0
POLL_S = 0.002


@dataclass(frozen=True)
class DeviceUnderTest:
    """One device of the bench.

    Attributes:
        name: Its name.
        fake: What the scenario says of it.
        driver: What the driver's configuration says of it, besides the address.
        outage: The fault that takes it away for a while.
    """

    name: str
    fake: Mapping[str, Any]
    driver: Mapping[str, Any]
    outage: str

    @property
    def on_tcp(self) -> bool:
        """Whether it has a TCP port rather than a terminal."""
        return self.fake["kind"] in ("festo_mpa", "qualisys")


CHAMBERS = [3, 2, 1, 0, 4, 5]
SUBJECTS = (
    DeviceUnderTest(
        "valves",
        {"kind": "festo_mpa", "valve_map": CHAMBERS},
        {"kind": "festo_mpa", "chambers": CHAMBERS, "maximum_pa": 50e3},
        "node_down",
    ),
    DeviceUnderTest("qtm", {"kind": "qualisys"}, {"kind": "qualisys"}, "shutdown"),
    DeviceUnderTest("gauge", {"kind": "lutron"}, {"kind": "lutron"}, "unplug"),
    DeviceUnderTest("bend", {"kind": "bendlabs"}, {"kind": "bendlabs"}, "unplug"),
    DeviceUnderTest("imu", {"kind": "bno08x_rvc", "section": "tip"}, {"kind": "bno08x_rvc"}, "unplug"),
)


def subjects() -> list[DeviceUnderTest]:
    """Return the devices for which there is a driver."""
    return [subject for subject in SUBJECTS if subject.driver["kind"] in KINDS]


class FakesProcess:
    """``softarm fakes`` in a process of its own, on the same addresses each time it starts.

    Args:
        folder: Where its scenario and its terminals are kept.
        devices: What it plays.
    """

    def __init__(self, folder: Path, devices: Sequence[DeviceUnderTest]) -> None:
        self.folder = folder
        self.ports = {subject.name: free_port() for subject in devices if subject.on_tcp}
        self._control = free_port()
        self._process: asyncio.subprocess.Process | None = None
        self._scenario = folder / "scenario.toml"
        self._scenario.write_text(tomli_w.dumps(self._describe(devices)))

    def _describe(self, devices: Sequence[DeviceUnderTest]) -> dict[str, Any]:
        parts = []
        for subject in devices:
            address = {"port": self.ports[subject.name]} if subject.on_tcp else {}
            parts.append({"name": subject.name, **subject.fake, **address})
        return {
            "name": "drivers",
            "control_port": self._control,
            "runtime_dir": str(self.folder / "terminals"),
            "plant": {"kind": "still"},
            "device": parts,
        }

    def driver_table(self, subject: DeviceUnderTest, **changes: Any) -> dict[str, Any]:
        """Return the configuration of the driver of one of its devices."""
        table = {"name": subject.name, "simulated": True, **subject.driver, **changes}
        if subject.on_tcp:
            return {**table, "host": "127.0.0.1", "port": self.ports[subject.name]}
        return {**table, "port": str(self.folder / "terminals" / subject.name)}

    async def start(self) -> None:
        """Start it and wait until every port is open."""
        self._process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "softarm",
            "fakes",
            "--scenario",
            str(self._scenario),
            "--json",
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.DEVNULL,
        )
        assert self._process.stdout is not None
        line = await asyncio.wait_for(self._process.stdout.readline(), PATIENCE_S)
        if not line:
            raise RuntimeError(f"softarm fakes --scenario {self._scenario} ended at once")

    async def stop(self) -> None:
        """End it."""
        process, self._process = self._process, None
        if process is not None:
            process.terminate()
            await process.wait()

    async def ask(self, **request: Any) -> dict[str, Any]:
        """Send one request to its control port and return the answer."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self._control, limit=1 << 20)
        writer.write(json.dumps(request).encode() + b"\n")
        answer = json.loads(await reader.readline())
        writer.close()
        await writer.wait_closed()
        if not answer["ok"]:
            raise RuntimeError(f"the fakes refuse {request}: {answer['error']}")
        assert isinstance(answer, dict)
        return answer


@dataclass
class Watch:
    """Keeps what one driver delivers.

    Attributes:
        readings: How many came.
        invalid: How many of them were invalid.
        last_valid_ns: Host monotonic time of the last valid one [ns].
        intervals: Time between arrivals.
        flags: What the readings said of themselves, with how often.
        judge: Takes each reading as well.
    """

    readings: int = 0
    invalid: int = 0
    last_valid_ns: int = 0
    intervals: Histogram = field(default_factory=Histogram)
    flags: Counter[str] = field(default_factory=Counter)
    judge: Callable[[Reading[Any]], None] = ignore
    _last_ns: int | None = None

    def take(self, reading: Reading[Any]) -> None:
        """Take one reading."""
        self.readings += 1
        self.invalid += not reading.valid
        self.flags.update(reading.flags)
        self.judge(reading)
        if reading.valid:
            self.last_valid_ns = reading.host_monotonic_ns
        if self._last_ns is not None:
            self.intervals.add(reading.host_monotonic_ns - self._last_ns)
        self._last_ns = reading.host_monotonic_ns

    def restart(self) -> None:
        """Count from here."""
        self.readings = self.invalid = 0
        self.intervals = Histogram()
        self._last_ns = None


def free_port() -> int:
    """Find a TCP port that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        number = probe.getsockname()[1]
        assert isinstance(number, int)
        return number


@dataclass(frozen=True)
class Bench:
    """Drivers connected to running fakes."""

    fakes: FakesProcess
    devices: Mapping[str, Device]
    watches: Mapping[str, Watch]


@contextlib.asynccontextmanager
async def connected(folder: Path, chosen: Sequence[DeviceUnderTest], **changes: Any) -> AsyncIterator[Bench]:
    """Run fakes and their drivers for the length of a block.

    Args:
        folder: For scenario and terminals.
        chosen: The devices.
        changes: Keys of the drivers' configurations that differ.
    """
    fakes = FakesProcess(folder, chosen)
    await fakes.start()
    watches = {subject.name: Watch() for subject in chosen}
    devices = {
        subject.name: load_devices([fakes.driver_table(subject, **changes)])[0].build(
            watches[subject.name].take
        )
        for subject in chosen
    }
    try:
        with contextlib.suppress(DeviceErrors):
            await connect_all(devices.values())
        for name, device in devices.items():
            await until_alive(device, name)
        yield Bench(fakes, devices, watches)
    finally:
        await close_all(devices.values())
        await fakes.stop()


async def until_alive(device: Device, name: str) -> None:
    """Wait until a device streams."""
    deadline = time.monotonic() + PATIENCE_S
    while device.state not in ALIVE:
        if time.monotonic() > deadline:
            raise RuntimeError(f"{name} did not connect: {device.health.last_error}")
        await asyncio.sleep(POLL_S)


async def sustained(bench: Bench, seconds: float) -> list[dict[str, Cell]]:
    """Count what each driver delivers at the device's own rate."""
    for watch in bench.watches.values():
        watch.restart()
    await asyncio.sleep(seconds)
    return [_rate_row(name, bench, seconds) for name in bench.devices]


def _rate_row(name: str, bench: Bench, seconds: float) -> dict[str, Cell]:
    watch, health = bench.watches[name], bench.devices[name].health
    trips = health.round_trip
    return {
        "device": name,
        "readings_per_s": watch.readings / seconds,
        "invalid": watch.invalid,
        "interval_p50_ms": watch.intervals.quantile_ns(0.5) / 1e6,
        "interval_p99_ms": watch.intervals.quantile_ns(0.99) / 1e6,
        "round_trip_p50_ms": trips.quantile_ns(0.5) / 1e6 if trips.count else None,
        "round_trip_p99_ms": trips.quantile_ns(0.99) / 1e6 if trips.count else None,
        "overruns": health.overruns,
    }


async def outages(bench: Bench, chosen: Sequence[DeviceUnderTest]) -> list[dict[str, Cell]]:
    """Take each device away for a while, then all of them at once, and time their return."""
    back_s = {}
    for subject in chosen:
        device, watch = bench.devices[subject.name], bench.watches[subject.name]
        began = time.monotonic()
        await bench.fakes.ask(do="fault", device=subject.name, fault=subject.outage, for_s=OUTAGE_S)
        lost_s = await _until_lost(device, began)
        back_s[subject.name] = (lost_s, await _until_valid(watch, began + OUTAGE_S))
    await bench.fakes.stop()
    await bench.fakes.start()
    restarted = time.monotonic()
    waits = [_until_valid(bench.watches[subject.name], restarted) for subject in chosen]
    after_restart = await asyncio.gather(*waits)
    return [
        {
            "device": subject.name,
            "noticed_after_s": back_s[subject.name][0],
            "back_after_outage_s": back_s[subject.name][1],
            "back_after_restart_s": restart_s,
            "reconnects": bench.devices[subject.name].health.reconnects,
        }
        for subject, restart_s in zip(chosen, after_restart, strict=True)
    ]


async def _until_lost(device: Device, began: float) -> float:
    while device.state in ALIVE:
        if time.monotonic() - began > PATIENCE_S:
            raise RuntimeError(f"{device.name} did not notice its outage")
        await asyncio.sleep(POLL_S)
    return time.monotonic() - began


async def _until_valid(watch: Watch, returned: float) -> float:
    """Wait for the first valid reading after a moment; return how long it took."""
    returned_ns = round(returned * NANOSECONDS)
    while watch.last_valid_ns <= returned_ns:
        if time.monotonic() - returned > PATIENCE_S:
            raise RuntimeError("a device did not come back")
        await asyncio.sleep(POLL_S)
    return (watch.last_valid_ns - returned_ns) / NANOSECONDS
