"""Random faults on all devices at once: is every one noticed, survived, and nothing mislabelled?"""

import asyncio
import contextlib
import math
import random
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from softarm.bench.driver_decoding import resident_kib
from softarm.bench.driver_wire import POLL_S, Bench, Subject, Watch, connected
from softarm.cli.output import Cell
from softarm.drivers.device import Device
from softarm.drivers.errors import DeviceError
from softarm.drivers.reading import Reading
from softarm.drivers.supervisor import State
from softarm.drivers.valves import BankReading, ValveBank

CALM_S = 0.6
CALM_TRIALS = 3
LASTING_S = (0.8, 1.6)
SLOW_FAULTS_S = {"stuck_valve": 8.0, "wrong_rate": 5.0}
ONCE_S = 0.3
BY_CHANCE = ("bit_flip", "byte_loss")
RECOVERY_S = 30.0
SETPOINT_S = 0.3
REST_S = 3.0
PRESSURES = ((20e3, 0.0, 10e3, 0.0, 15e3, 5e3), (0.0, 20e3, 0.0, 20e3, 5e3, 15e3))
HIGHEST_PA = 300e3
NO_SIGNS = ("frames", "overruns")

CUT = "TCP may cut or join anywhere"
LATE = "the rest of the frame came later, whole"
NO_CHECK = "a digit may turn into another or vanish: the format has no checksum"
UNSEEN: Mapping[str, Mapping[str, str]] = {
    "valves": {
        "delay": "an answer within its time is an answer",
        "no_watchdog": "the register is read when connecting",
        "reading_offset": "a plausible pressure",
        "refuse": "concerns new connections",
        "split_reply": CUT,
    },
    "qtm": {
        "coalesce": CUT,
        "split": CUT,
        "full": "concerns new connections",
        "latency": "how late every frame is cannot be seen",
        "udp_loss": "frames come by TCP",
    },
    "gauge": {
        "bit_flip": NO_CHECK,
        "offset": "a plausible force",
        "operator_zero": "an unloaded gauge shows zero before and after",
        "stall": LATE,
    },
    "bend": {
        "bit_flip": NO_CHECK,
        "byte_loss": NO_CHECK,
        "dropout": "a bend that rests repeats, too",
        "stall": LATE,
    },
    "imu": {"false_header": "a good frame with a start inside", "stall": LATE},
}
"""By device, the faults that nothing on its wire betrays, and why."""


@dataclass
class Judge:
    """Holds each reading against what must be true of every one.

    Attributes:
        violations: What was not true, with how often.
        told: What the values themselves said of trouble, with how often.
    """

    violations: Counter[str] = field(default_factory=Counter)
    told: Counter[str] = field(default_factory=Counter)
    _before: Reading[Any] | None = None

    def take(self, reading: Reading[Any]) -> None:
        """Judge one reading."""
        self._label(reading)
        if reading.valid and (what := _implausible(reading.value)):
            self.violations[what] += 1
        if getattr(reading.value, "drop_rate", 0):
            self.told["drop rate"] += 1
        self._before = reading

    def _label(self, reading: Reading[Any]) -> None:
        before = self._before
        checks = {
            "source does not say fake": reading.source.startswith("fake+"),
            "measured after it arrived": reading.measured_ns <= reading.host_monotonic_ns,
        }
        if before is not None:
            checks["arrived before the one before"] = reading.host_monotonic_ns >= before.host_monotonic_ns
            checks["epoch went back"] = reading.epoch >= before.epoch
            if reading.epoch == before.epoch:
                checks["sequence did not rise"] = reading.sequence > before.sequence or not reading.valid
                checks["old device time, new reading"] = _later(before, reading)
        self.violations.update(what for what, holds in checks.items() if not holds)


def _later(before: Reading[Any], reading: Reading[Any]) -> bool:
    if not reading.valid or reading.device_time_ns is None or before.device_time_ns is None:
        return True
    return reading.device_time_ns > before.device_time_ns


def _implausible(value: Any) -> str:
    """Name what no fake ever shows, whatever its faults; such a value was scrambled on the way."""
    if isinstance(value, BankReading):
        inside = all(abs(pressure) < HIGHEST_PA for pressure in value.readback)
        return "" if inside else "pressure beyond the supply"
    poses = getattr(value, "poses", None)
    if poses is not None:
        return "" if all(map(_is_pose, poses.values())) else "pose that is none"
    return "" if _finite(value) else "value that is no number"


def _is_pose(pose: Any) -> bool:
    if pose is None:
        return True
    unit = math.isclose(math.hypot(*pose.quaternion), 1.0, abs_tol=1e-6)
    return unit and math.hypot(*pose.position) < 3.0


def _finite(value: Any) -> bool:
    numbers = [getattr(value, name, 0.0) for name in ("force", "gross")]
    numbers += getattr(value, "quaternion", ())
    for pair in getattr(value, "angles", ()):
        numbers += pair
    return all(math.isfinite(number) for number in numbers)


@dataclass
class Outcome:
    """What came of one kind of fault on one device.

    Attributes:
        struck: How often it struck; of those that strike by chance, how often they showed on the wire.
        unrecovered: After how many the device was not well again in time.
        noticed: How often the driver counted, flagged or told something.
        slowest_s: Longest time from its end to the next valid reading [s].
        told: What the driver noticed it by.
    """

    struck: int = 0
    unrecovered: int = 0
    noticed: int = 0
    slowest_s: float = 0.0
    told: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True)
class Soak:
    """What came of the whole run.

    Attributes:
        outcomes: By device and fault.
        judges: By device.
        readings: By device.
        leaked: Tasks that were left when all was closed.
        stray: Errors that ended in the event loop.
        grown_kib: Growth of the resident set [KiB].
        seconds: How long it took.
    """

    outcomes: Mapping[str, Mapping[str, Outcome]]
    judges: Mapping[str, Judge]
    readings: Mapping[str, int]
    leaked: Sequence[str]
    stray: Sequence[str]
    grown_kib: int
    seconds: float

    @property
    def sound(self) -> bool:
        """Whether nothing was leaked, mislabelled or missed."""
        missed = any(
            outcome.unrecovered or (outcome.noticed < outcome.struck and fault not in UNSEEN.get(device, {}))
            for device, faults in self.outcomes.items()
            for fault, outcome in faults.items()
        )
        mislabelled = any(judge.violations for judge in self.judges.values())
        return not (missed or mislabelled or self.leaked or self.stray)


async def soak(folder: Path, chosen: Sequence[Subject], seconds: float, seed: int) -> Soak:
    """Strike all devices with random faults, each with one at a time.

    Args:
        folder: For scenario and terminals.
        chosen: The devices.
        seconds: How long [s].
        seed: Seed of the faults.
    """
    stray: list[str] = []
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(lambda _, context: stray.append(str(context.get("message"))))
    judges = {subject.name: Judge() for subject in chosen}
    outcomes: dict[str, dict[str, Outcome]] = {subject.name: {} for subject in chosen}
    before = asyncio.all_tasks()
    async with connected(folder, chosen) as bench:
        for name, watch in bench.watches.items():
            watch.judge = judges[name].take
        resident, began = resident_kib(), time.monotonic()
        catalogue = (await bench.fakes.ask(do="catalogue"))["faults"]
        async with asyncio.TaskGroup() as tasks:
            moving = [tasks.create_task(_move(bank)) for bank in _banks(bench)]
            striking = [
                tasks.create_task(
                    _strike(
                        Target(bench, subject.name, judges[subject.name]),
                        catalogue[subject.name],
                        outcomes[subject.name],
                        random.Random(f"{seed}/{subject.name}"),
                        began + seconds,
                    )
                )
                for subject in chosen
            ]
            await asyncio.wait(striking)
            for task in moving:
                task.cancel()
        grown, elapsed = resident_kib() - resident, time.monotonic() - began
        readings = {name: watch.readings for name, watch in bench.watches.items()}
    leaked = [task.get_name() for task in asyncio.all_tasks() - before]
    return Soak(outcomes, judges, readings, leaked, stray, grown, elapsed)


def _banks(bench: Bench) -> list[ValveBank]:
    return [device for device in bench.devices.values() if isinstance(device, ValveBank)]


async def _move(bank: ValveBank) -> None:
    """Keep the valves busy as a control loop would, arming again whenever that is allowed."""
    while True:
        with contextlib.suppress(DeviceError):
            if not bank.armed:
                bank.arm()
            bank.command(PRESSURES[int(time.monotonic() / REST_S) % 2], SETPOINT_S)
        await asyncio.sleep(0.05)


@dataclass(frozen=True)
class Target:
    """One device under faults."""

    bench: Bench
    name: str
    judge: Judge

    @property
    def device(self) -> Device:
        """Its driver."""
        return self.bench.devices[self.name]

    @property
    def watch(self) -> Watch:
        """What it delivers."""
        return self.bench.watches[self.name]

    def signs(self) -> dict[str, int]:
        """Everything by which the driver tells of trouble, as counts."""
        summary = self.device.health.summary()
        signs = {
            key: value for key, value in summary.items() if isinstance(value, int) and key not in NO_SIGNS
        }
        signs |= {f"event: {key}": value for key, value in summary["events"].items()}
        signs |= {f"flag: {key}": value for key, value in self.watch.flags.items()}
        signs |= self.judge.told
        return signs | {"invalid readings": self.watch.invalid}

    async def shown(self, fault: str) -> int:
        """Ask the fake how often a fault has shown on the wire."""
        status = await self.bench.fakes.ask(do="status")
        (counts,) = [device["counts"] for device in status["devices"] if device["name"] == self.name]
        return int(counts.get(fault, 0))


async def _strike(
    target: Target,
    catalogue: Sequence[Mapping[str, Any]],
    outcomes: dict[str, Outcome],
    dice: random.Random,
    until: float,
) -> None:
    """Go through the faults of one device in random order, again and again."""
    while True:
        for fault in dice.sample(catalogue, len(catalogue)):
            if time.monotonic() > until:
                return
            restless = await _settle(target, dice)
            outcome = outcomes.setdefault(fault["fault"], Outcome())
            lasting_s = SLOW_FAULTS_S.get(fault["fault"], dice.uniform(*LASTING_S))
            await _strike_once(target, fault, lasting_s, outcome, restless)


async def _settle(target: Target, dice: random.Random) -> set[str]:
    """Wait until nothing is told any more, and give what is told all the same."""
    restless: set[str] = set()
    for _ in range(CALM_TRIALS):
        before = target.signs()
        await asyncio.sleep(CALM_S * dice.uniform(0.5, 1.5))
        restless = _changed(before, target.signs())
        if not restless:
            break
    return restless


async def _strike_once(
    target: Target, fault: Mapping[str, Any], lasting_s: float, outcome: Outcome, restless: set[str]
) -> None:
    """Switch a fault on, wait until the device is well again, and keep by what it was noticed."""
    name = fault["fault"]
    before, shown = target.signs(), await target.shown(name)
    told: set[str] = set()
    standing = {alarm.key for alarm in target.device.health.alarms.standing}
    lasting = {} if fault["once"] else {"for_s": lasting_s}
    await target.bench.fakes.ask(do="fault", device=target.name, fault=name, **lasting)
    ends = time.monotonic() + (ONCE_S if fault["once"] else lasting_s)
    while time.monotonic() < ends or not _well(target, ends):
        keys = {alarm.key for alarm in target.device.health.alarms.standing}
        told |= {f"alarm: {key}" for key in keys - standing}
        if time.monotonic() > ends + RECOVERY_S:
            outcome.unrecovered += 1
            break
        await asyncio.sleep(10 * POLL_S)
    outcome.slowest_s = max(outcome.slowest_s, time.monotonic() - ends)
    told |= _changed(before, target.signs()) - restless
    if name not in BY_CHANCE or await target.shown(name) > shown:
        outcome.struck += 1
        outcome.noticed += bool(told)
        outcome.told.update(told)


def _changed(before: Mapping[str, int], after: Mapping[str, int]) -> set[str]:
    return {key for key, count in after.items() if count != before.get(key, 0)}


def _well(target: Target, since: float) -> bool:
    return target.device.state is State.STREAMING and target.watch.last_valid_ns > since * 1e9


def rows_by_device(soaked: Soak) -> list[dict[str, Cell]]:
    """Sum up each device."""
    rows: list[dict[str, Cell]] = []
    for device, faults in soaked.outcomes.items():
        judge = soaked.judges[device]
        rows.append(
            {
                "device": device,
                "readings": soaked.readings[device],
                "faults": sum(outcome.struck for outcome in faults.values()),
                "noticed": sum(outcome.noticed for outcome in faults.values()),
                "beyond_notice": sum(
                    outcome.struck - outcome.noticed
                    for fault, outcome in faults.items()
                    if fault in UNSEEN.get(device, {})
                ),
                "slowest_recovery_s": max((outcome.slowest_s for outcome in faults.values()), default=0.0),
                "mislabelled": sum(judge.violations.values()),
                "how": ", ".join(judge.violations) or None,
            }
        )
    return rows


def rows_by_fault(soaked: Soak) -> list[dict[str, Cell]]:
    """Tell of each fault how it was noticed, or why it cannot be."""
    return [
        {
            "device": device,
            "fault": fault,
            "struck": outcome.struck,
            "noticed": outcome.noticed,
            "slowest_recovery_s": outcome.slowest_s,
            "by": ", ".join(sign for sign, _ in outcome.told.most_common(4))
            or UNSEEN.get(device, {}).get(fault, "MISSED"),
        }
        for device, faults in soaked.outcomes.items()
        for fault, outcome in sorted(faults.items())
    ]
