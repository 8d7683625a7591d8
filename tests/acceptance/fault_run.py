"""All kinds of devices at once under random faults, in accelerated time, each value held against the truth.

Fakes and drivers share one event loop whose waits are shortened, over real sockets and terminals. The truth
of every moment is kept, so that a value under a wrong name, or an old value with a new time, is found out.
"""

import asyncio
import contextlib
import math
import random
import time
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from acceptance.fault_subjects import CHAMBERS, SUBJECTS, Moment, Subject
from acceptance.warp import WarpLoop
from softarm.common.tables import Cell
from softarm.drivers.device import Device, close_all, connect_all
from softarm.drivers.errors import DeviceError, DeviceErrors
from softarm.drivers.reading import Reading
from softarm.drivers.registry import load_devices
from softarm.drivers.supervisor import ConnectionState
from softarm.drivers.valves import ValveBank
from softarm.fakes.rig import running
from softarm.fakes.scenario import check_scenario

STEP_S = 0.005
TRUTH_S = 1.0
BLIND_S = 1.5
REST_S = (0.3, 1.5)
LASTING_S = (0.7, 2.0)
ONCE_S = 0.6
PATIENCE_S = 30.0
LOOK_S = 0.02
CORD = {"section": "tip", "hook_m": [0.1, 0.0, -0.5], "length_m": 0.1}
CORD_STIFFNESS = 60.0


@dataclass
class Outcome:
    """What became of one device.

    Attributes:
        readings: Readings that came.
        invalid: Those that said of themselves that they may not be used.
        checked: Valid ones that were held against the truth.
        blind: Valid ones of a time when the wire carried wrong values that nothing betrays.
        mislabelled: Valid ones that were not true at their time, or broke the order of time and epoch.
        faults: Faults that showed on the wire.
        noticed: Of these, those of which the driver told.
        unnoticed: Faults of which it should have told and did not, with how often.
        slowest_s: Longest time from the end of a fault until the device was well [s].
        unrecovered: Faults after which it was not well in time.
        examples: The first few violations, in words.
    """

    readings: int = 0
    invalid: int = 0
    checked: int = 0
    blind: int = 0
    mislabelled: int = 0
    faults: int = 0
    noticed: int = 0
    unnoticed: Counter[str] = field(default_factory=Counter)
    slowest_s: float = 0.0
    unrecovered: int = 0
    examples: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Run:
    """What became of a run.

    Attributes:
        outcomes: By device.
        leaked: Tasks that were left when everything was closed.
        stray: Errors that ended in the event loop.
        virtual_s: How long it lasted for fakes and drivers [s].
        seconds: How long it took [s].
    """

    outcomes: Mapping[str, Outcome]
    leaked: Sequence[str]
    stray: Sequence[str]
    virtual_s: float
    seconds: float

    @property
    def sound(self) -> bool:
        """Whether nothing leaked, was mislabelled, missed or lost for good."""
        wrong = any(o.mislabelled or o.unnoticed or o.unrecovered for o in self.outcomes.values())
        return not (wrong or self.leaked or self.stray)


class Watcher:
    """The sink of one driver: holds every reading against the truth.

    Args:
        subject: The device.
        truth: The moments of the last while.
        outcome: Where to count.
    """

    def __init__(self, subject: Subject, truth: deque[Moment], outcome: Outcome) -> None:
        self.outcome = outcome
        self.signs: Counter[str] = Counter()
        self.last_valid = 0.0
        self.blind_until = 0.0
        self._subject = subject
        self._truth = truth
        self._before: Reading[Any] | None = None

    def __call__(self, reading: Reading[Any]) -> None:
        """Take one reading."""
        self.outcome.readings += 1
        self.signs.update(reading.flags)
        self._check_order(reading)
        self.signs["lost"] += bool(getattr(reading.value, "lost_for_s", None))
        if not reading.valid:
            self.outcome.invalid += 1
            self.signs["invalid"] += 1
            return
        arrived = reading.host_monotonic_ns / 1e9
        self.last_valid = arrived
        if arrived < self.blind_until:
            self.outcome.blind += 1
        else:
            self._check_value(reading)

    def _check_order(self, reading: Reading[Any]) -> None:
        before, self._before = self._before, reading
        holds = reading.source.startswith("fake+") and reading.device == self._subject.name
        holds = holds and reading.measured_ns <= reading.host_monotonic_ns
        if before is not None:
            holds = holds and reading.epoch >= before.epoch
            holds = holds and reading.host_monotonic_ns >= before.host_monotonic_ns
            if reading.epoch == before.epoch and reading.valid:
                holds = holds and reading.sequence > before.sequence
        if not holds:
            self._violated(f"order: {before} then {reading}")

    def _check_value(self, reading: Reading[Any]) -> None:
        self.outcome.checked += 1
        measured = reading.measured_ns / 1e9
        window = self._subject.window
        moments = [m for m in self._truth if -window <= m[0] - measured <= 2.1 * STEP_S]
        error = min((self._subject.error(reading.value, moment) for moment in moments), default=math.inf)
        if error > 1.0:
            self._violated(f"{error:.1f} times too far from the truth: {reading}")

    def _violated(self, what: str) -> None:
        self.outcome.mislabelled += 1
        if len(self.outcome.examples) < 3:
            self.outcome.examples.append(f"{self._subject.name}, {what}")


def clock() -> int:
    """Read the time of the running loop [ns]."""
    return round(asyncio.get_running_loop().time() * 1e9)


def run(seconds: float, seed: int, speed: float = 20.0, chosen: Sequence[Subject] = SUBJECTS) -> Run:
    """Strike all devices with random faults, each with one at a time, and judge what comes.

    Args:
        seconds: How long, in virtual time [s].
        seed: Seed of fakes and faults.
        speed: Virtual seconds per second of waiting.
        chosen: The devices.
    """
    with asyncio.Runner(loop_factory=lambda: WarpLoop(speed)) as runner:
        return runner.run(_run(seconds, seed, chosen))


async def _run(seconds: float, seed: int, chosen: Sequence[Subject]) -> Run:
    stray: list[str] = []
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(lambda _, context: stray.append(str(context.get("message"))))
    before, began, started = asyncio.all_tasks(), loop.time(), time.monotonic()
    outcomes = {subject.name: Outcome() for subject in chosen}
    async with running(check_scenario(_scenario(seed, chosen))) as rig:
        truth: deque[Moment] = deque(maxlen=round(TRUTH_S / STEP_S))
        targets = [_target(rig, subject, truth, outcomes[subject.name]) for subject in chosen]
        devices = [target.device for target in targets]
        remembering = asyncio.create_task(_remember(rig, truth), name="truth")
        await connect_all(devices)
        banks = [device for device in devices if isinstance(device, ValveBank)]
        moving = [asyncio.create_task(_move(bank), name="moving") for bank in banks]
        end = began + seconds
        dice = random.Random(seed)
        await asyncio.gather(*(_strike(target, random.Random(dice.random()), end) for target in targets))
        await close_all(devices)
        for task in (remembering, *moving):
            task.cancel()
        await asyncio.wait((remembering, *moving))
    leaked = [task.get_name() for task in asyncio.all_tasks() - before]
    return Run(outcomes, leaked, stray, loop.time() - began, time.monotonic() - started)


def _scenario(seed: int, chosen: Sequence[Subject]) -> dict[str, Any]:
    return {
        "seed": seed,
        "step_s": STEP_S,
        "control_port": None,
        "plant": {"kind": "still", "switches": {"cord_stiffness": CORD_STIFFNESS}},
        "cord": CORD,
        "device": [{"name": subject.name, **subject.fake} for subject in chosen],
    }


@dataclass(frozen=True)
class Target:
    """One device under faults: its fake's bench, its driver and what it delivers."""

    rig: Any
    subject: Subject
    device: Device
    watcher: Watcher

    def signs(self) -> dict[str, Any]:
        """Return everything by which the driver tells of trouble."""
        summary = self.device.health.summary()
        told = {k: v for k, v in summary.items() if isinstance(v, int) and k not in ("frames", "overruns")}
        return told | dict(summary["events"]) | dict(self.watcher.signs)

    def well(self, since: float) -> bool:
        """Return whether it streams and has delivered a valid reading since a time [s]."""
        return self.device.state is ConnectionState.STREAMING and self.watcher.last_valid > since


def _target(rig: Any, subject: Subject, truth: deque[Moment], outcome: Outcome) -> Target:
    (endpoint,) = [e for e in rig.endpoints() if e.name == subject.name]
    address = {"host": endpoint.host, "port": endpoint.port} if endpoint.host else {"port": endpoint.path}
    table = {"name": subject.name, "simulated": True, **subject.driver, **address}
    watcher = Watcher(subject, truth, outcome)
    return Target(rig, subject, load_devices([table])[0].build(watcher, clock), watcher)


async def _remember(rig: Any, truth: deque[Moment]) -> None:
    """Keep the truth of every step."""
    loop = asyncio.get_running_loop()
    offset = loop.time() - rig.clock.now()
    node = next(iter(rig.valve_ports.values())).node if rig.valve_ports else None
    while True:
        outlets = node.pressures()[CHAMBERS] if node else rig.state.chamber_pressures
        truth.append((rig.world.time + offset, rig.state, outlets))
        await asyncio.sleep(STEP_S)


async def _move(bank: ValveBank) -> None:
    """Move the arm as a control loop would, arming again whenever that is allowed."""
    while True:
        phase = 2.0 * math.pi * 0.2 * clock() / 1e9
        pressures = [7e3 * k + 5e3 * (1.0 + math.sin(phase + k)) for k in range(6)]
        with contextlib.suppress(DeviceError):
            if not bank.armed:
                bank.arm()
            bank.command(pressures, 0.3)
        await asyncio.sleep(0.05)


async def _strike(target: Target, dice: random.Random, end: float) -> None:
    """Go through the faults of one device in random order, again and again."""
    loop = asyncio.get_running_loop()
    board = target.rig.boards[target.subject.name]
    faults = [fault for name, fault in board.catalogue.items() if name not in target.subject.left_out]
    while True:
        for fault in dice.sample(faults, len(faults)):
            await asyncio.sleep(dice.uniform(*REST_S))
            if loop.time() >= end:
                return
            await _strike_once(target, fault, board, dice)


async def _strike_once(target: Target, fault: Any, board: Any, dice: random.Random) -> None:
    """Switch a fault on and off, wait until the device is well, and keep whether it was noticed."""
    loop, subject, watcher = asyncio.get_running_loop(), target.subject, target.watcher
    before, hits = target.signs(), board.counts[fault.name]
    standing = {alarm.key for alarm in target.device.health.alarms.active}
    lasts = ONCE_S if fault.once else dice.uniform(*LASTING_S)
    if fault.name in subject.blind:
        watcher.blind_until = math.inf
    fixed = subject.parameters.get(fault.name)
    board.set(fault.name, _draw(fault, dice) if fixed is None else fixed)
    ends, noticed, waits = loop.time() + lasts, False, True
    while waits:
        await asyncio.sleep(LOOK_S)
        noticed = noticed or target.device.state is not ConnectionState.STREAMING
        noticed = noticed or bool({a.key for a in target.device.health.alarms.active} - standing)
        if loop.time() >= ends and board.active(fault.name):
            board.clear(fault.name)
        await _revive(target)
        late = loop.time() > ends + PATIENCE_S
        waits = loop.time() < ends or not (target.well(ends) or late)
    if fault.name in subject.blind:
        watcher.blind_until = loop.time() + BLIND_S
    outcome = watcher.outcome
    outcome.unrecovered += not target.well(ends)
    outcome.slowest_s = max(outcome.slowest_s, loop.time() - ends)
    if board.counts[fault.name] > hits:
        noticed = noticed or target.signs() != before
        outcome.faults += 1
        outcome.noticed += noticed
        if not noticed and fault.name not in subject.quiet:
            outcome.unnoticed[fault.name] += 1


async def _revive(target: Target) -> None:
    """Do what an operator does after an error that is not retried: connect again."""
    if target.device.state is ConnectionState.FAULT and not target.device.supervisor.retrying:
        await target.device.close()
        with contextlib.suppress(DeviceErrors):
            await target.device.connect()


def _draw(fault: Any, dice: random.Random) -> dict[str, Any]:
    """Draw the words among a fault's parameters; numbers keep their defaults."""
    return {
        name: dice.choice(fault.limits[name])
        for name, value in fault.parameters.items()
        if isinstance(value, str) and name in fault.limits
    }


def rows(result: Run) -> list[dict[str, Cell]]:
    """Sum up each device."""
    return [
        {
            "device": name,
            "readings": outcome.readings,
            "checked": outcome.checked,
            "mislabelled": outcome.mislabelled,
            "faults": outcome.faults,
            "noticed": outcome.noticed,
            "unnoticed": ", ".join(outcome.unnoticed) or None,
            "slowest_recovery_s": outcome.slowest_s,
            "unrecovered": outcome.unrecovered,
        }
        for name, outcome in result.outcomes.items()
    ]
