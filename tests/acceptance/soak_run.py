"""One soak: a rig under faults, a commander, visitors, and what became of replies, memory and recordings."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from acceptance.processes import child_of, resident_kib
from softarm.common.shipped import DEMO_SCENARIO, fake_specimen
from softarm.estimator.errors import InputError
from softarm.experiments.rig import FakeRig, RigSettings, free_endpoint
from softarm.experiments.rig_control import FakeControl
from softarm.experiments.session import connect, wait_ready
from softarm.recordings import load_recording
from softarm_client import Arm
from softarm_client.errors import CommandRefusedError
from softarm_client.messages import Estimate, Message, State

READER_NICER = 19
"""Recordings are read while the next one is written, by a process that gives way to all others."""
SETTLE_SHARE = 0.2
FAULTS = (
    ("valves", "freeze"),
    ("valves", "node_down"),
    ("valves", "second_master"),
    ("valves", "late_reply"),
    ("qtm", "silence"),
    ("qtm", "reset_connection"),
    ("qtm", "body_lost"),
    ("bend", "unplug"),
    ("bend", "bit_flip"),
    ("gauge", "silence"),
)
NO_ANSWER = "no answer in time"
VISITOR = """
import sys, time
from softarm_client import Arm
with Arm(sys.argv[1], sys.argv[2], name="visitor") as client:
    with client.states().subscribe(lambda _: None), client.estimates().subscribe(lambda _: None):
        time.sleep(float(sys.argv[3]))
"""


@dataclass(frozen=True)
class SoakSettings:
    """How a soak is run.

    Args:
        folder: Takes logs and recordings.
        seconds: How long.
        model: What the estimator runs on.
        seed: Of faults and clients.
        fault_every_s: Time from one fault to the next [s].
        visitor_every_s: Time from one short-lived client to the next [s].
        recording_s: Length of a recording [s].
    """

    folder: Path
    seconds: float
    model: str
    seed: int
    fault_every_s: float = 5.0
    visitor_every_s: float = 4.0
    recording_s: float = 8.0


@dataclass(frozen=True)
class SoakResult:
    """What became of a soak.

    Args:
        figures: What was counted, by name.
    """

    figures: dict[str, float | int | str]

    def sound(self, growth_percent: float) -> bool:
        """Return whether nothing was lost, nothing grows and no process ended.

        Args:
            growth_percent: Growth of memory that is allowed.
        """
        grown = max(float(v) for k, v in self.figures.items() if k.endswith("growth_percent"))
        losses = ("replies_lost", "recordings_unreadable", "estimator_restarts")
        lost = sum(int(self.figures[name]) for name in losses)
        return lost == 0 and grown <= growth_percent and self.figures["service_ended"] == "no"


@dataclass
class Tally:
    """What is counted while it runs."""

    answered: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    lost: Counter[str] = field(default_factory=Counter)
    faults: int = 0
    visitors: int = 0
    readable: list[Future[bool]] = field(default_factory=list)
    slowest_s: float = 0.0
    slowest_verb: str = ""
    states: int = 0
    estimates: Counter[str] = field(default_factory=Counter)
    faulted: int = 0


class Soak:
    """Runs one soak.

    Args:
        settings: How.
        advance: Called with seconds as they pass.
    """

    def __init__(self, settings: SoakSettings, advance: Callable[[float], None]) -> None:
        self._settings = settings
        self._advance = advance
        self._tally = Tally()
        self._stop = threading.Event()
        self._first: State | None = None
        self._last: State | None = None
        self._reader = ProcessPoolExecutor(1, get_context("spawn"), os.nice, (READER_NICER,))

    def run(self) -> SoakResult:
        """Start everything, let it run, and sum up."""
        settings = self._settings
        wanted = RigSettings(
            DEMO_SCENARIO,
            specimen=str(fake_specimen()),
            endpoint=free_endpoint(),
            model=settings.model,
            sensors=("orientation", "bend"),
            forces_on=("tip",),
        )
        rig = FakeRig(wanted, settings.folder)
        with (
            self._reader,
            rig,
            connect(rig) as client,
            FakeControl(str(rig.announcement["control"])) as fakes,
        ):
            wait_ready(client)
            memory = MemoryGrowth(rig)
            dice = random.Random(settings.seed)
            workers = [
                threading.Thread(target=self._strike, args=(fakes, random.Random(dice.random()))),
                threading.Thread(target=self._visit, args=(rig, random.Random(dice.random()))),
                threading.Thread(target=self._command, args=(client, random.Random(dice.random()))),
            ]
            with client.states().subscribe(self._see), client.estimates().subscribe(self._count):
                for worker in workers:
                    worker.start()
                self._watch(memory)
                self._stop.set()
                for worker in workers:
                    worker.join()
            ended = rig.service.process.poll() is not None
            return self._sum_up(memory, ended)

    def _see(self, message: Message) -> None:
        if isinstance(message, State):
            if message.mode == "FAULTED" and (self._last is None or self._last.mode != "FAULTED"):
                self._tally.faulted += 1
            self._first = self._first or message
            self._last = message
            self._tally.states += 1

    def _count(self, estimate: Estimate) -> None:
        self._tally.estimates[estimate.model if estimate.status != "not_converged" else estimate.status] += 1

    def _watch(self, memory: "MemoryGrowth") -> None:
        begin = time.monotonic()
        settled = begin + SETTLE_SHARE * self._settings.seconds
        while (now := time.monotonic()) < begin + self._settings.seconds:
            memory.look(settled=now > settled)
            self._stop.wait(1.0)
            self._advance(time.monotonic() - now)

    def _strike(self, fakes: FakeControl, dice: random.Random) -> None:
        while not self._stop.wait(self._settings.fault_every_s):
            device, fault = dice.choice(FAULTS)
            fakes.ask("fault", device=device, fault=fault, for_s=dice.uniform(0.5, 2.0))
            self._tally.faults += 1

    def _visit(self, rig: FakeRig, dice: random.Random) -> None:
        visitors: list[subprocess.Popen[bytes]] = []
        with contextlib.ExitStack() as stack:
            while not self._stop.wait(self._settings.visitor_every_s):
                visitors = [visitor for visitor in visitors if visitor.poll() is None]  # leaves no dead one
                stay_s = dice.uniform(3.0, 8.0)
                words = [sys.executable, "-c", VISITOR, rig.settings.arm, rig.settings.endpoint, f"{stay_s}"]
                visitor = stack.enter_context(subprocess.Popen(words))
                visitors.append(visitor)
                self._tally.visitors += 1
                if dice.random() < 0.3:
                    self._stop.wait(2.0)
                    visitor.send_signal(signal.SIGSTOP)
                    self._stop.wait(2.0)
                    visitor.send_signal(signal.SIGCONT)
                if dice.random() < 0.3:
                    visitor.kill()
            for visitor in visitors:
                visitor.kill()

    def _command(self, client: Arm, dice: random.Random) -> None:
        """Arm, play, teach, hold, clear, record: what the mode allows, and some that it does not."""
        record_at = time.monotonic()
        while not self._stop.wait(0.1):
            self._renew(client)
            if self._last is None:
                continue
            verb, fields = _next(self._last, dice)
            self._ask(client, verb, **fields)
            if time.monotonic() > record_at:
                record_at = time.monotonic() + self._settings.recording_s
                self._ask(client, "record/stop", timeout_s=10.0)
                self._ask(client, "record/start", name="soak")
        self._ask(client, "record/stop", timeout_s=20.0)
        self._ask(client, "stop")

    def _renew(self, client: Arm) -> None:
        """Renew the lease as a client does."""
        try:
            client.acquire()
            self._tally.answered += 1
        except CommandRefusedError as refusal:
            self._tally.lost["lease/acquire"] += refusal.refusal.message == NO_ANSWER

    def _ask(self, client: Arm, verb: str, timeout_s: float = 1.0, **fields: object) -> None:
        begin = time.monotonic()
        try:
            applied = client.command(verb, timeout_s=timeout_s, **fields)
        except CommandRefusedError as refusal:
            if refusal.refusal.message == NO_ANSWER:
                self._tally.lost[verb] += 1
            else:
                self._tally.refused[refusal.refusal.code] += 1
            return
        finally:
            took_s = time.monotonic() - begin
            if took_s > self._tally.slowest_s:
                self._tally.slowest_s, self._tally.slowest_verb = took_s, verb
        self._tally.answered += 1
        if verb == "record/stop":
            path = Path(str(applied.applied["path"]))
            self._tally.readable.append(self._reader.submit(_is_readable, path))

    def _sum_up(self, memory: "MemoryGrowth", ended: bool) -> SoakResult:
        tally, first, last = self._tally, self._first, self._last
        assert first is not None, "no state came"
        assert last is not None, "no state came"
        ticks, skipped = last.ticks - first.ticks, last.overruns - first.overruns
        unreadable = sum(not found.result() for found in tally.readable)
        figures: dict[str, float | int | str] = {
            "commands_answered": tally.answered,
            "commands_refused": sum(tally.refused.values()),
            "replies_lost": tally.lost.total(),
            "replies_lost_of": ", ".join(sorted(+tally.lost)) or "-",
            "slowest_reply_ms": 1e3 * tally.slowest_s,
            "slowest_reply_of": tally.slowest_verb,
            "device_faults": tally.faults,
            "modes_ended_by_faults": tally.faulted,
            "clients_come_and_gone": tally.visitors,
            "states_received": tally.states,
            "estimates_received": tally.estimates.total(),
            "estimates_on_fem": tally.estimates["fem"],
            "estimates_on_rod": tally.estimates["rod"],
            "ticks": ticks,
            "ticks_skipped": skipped,
            "ticks_skipped_percent": 100.0 * skipped / max(ticks + skipped, 1),
            "recordings": len(tally.readable),
            "recordings_unreadable": unreadable,
            "estimator_restarts": restarts(self._settings.folder / "service.log"),
            **memory.figures(),
            "service_ended": "yes" if ended else "no",
        }
        return SoakResult(figures)


def _next(state: State, dice: random.Random) -> tuple[str, dict[str, Any]]:
    """Choose a command that suits the mode, and now and then one that does not."""
    pressures = [dice.uniform(0.0, 30e3) for _ in state.asked_pa]
    play = ("set_pressures", {"pressures_pa": pressures, "lifetime_s": 1.0})
    if dice.random() < 0.02:
        return "set_pressures", {"pressures_pa": [9e5] * len(pressures), "lifetime_s": 1.0}
    if state.mode == "FAULTED":
        return "clear", {}
    if state.mode == "IDLE":
        return "arm", {}
    if state.mode == "ARMED":
        return dice.choice((play, play, play, ("teach/start", {})))
    if state.mode == "TEACH":
        return dice.choice((("teach/hold", {"ramp_s": 0.5}), ("teach/release", {}), ("disarm", {})))
    return dice.choice((("teach/release", {}), ("teach/save", {"name": "soak"}), ("disarm", {})))


def _is_readable(path: Path) -> bool:
    try:
        return len(load_recording(path).time) > 1
    except InputError:
        return False


def restarts(log: Path) -> int:
    """Count how often the service had to start its estimator again, by its log."""
    return sum("the estimator died" in line for line in log.read_text().splitlines())


class MemoryGrowth:
    """Resident memory of the service's processes.

    Args:
        rig: The running rig.
    """

    def __init__(self, rig: FakeRig) -> None:
        self._service = rig.service.process.pid
        self._early: dict[str, int] = {}
        self._late: dict[str, int] = {}

    def look(self, settled: bool) -> None:
        """Read the memory of each process; until it has settled only the highest counts."""
        estimator = child_of(self._service)
        for name, pid in (("control", self._service), ("estimator", estimator)):
            kib = resident_kib(pid)
            if not settled or name not in self._early:
                self._early[name] = max(self._early.get(name, 0), kib)
            self._late[name] = kib

    def figures(self) -> dict[str, float | int | str]:
        """Sum up."""
        found: dict[str, float | int | str] = {}
        for name, early in self._early.items():
            late = self._late[name]
            found[f"{name}_mb"] = late / 1024
            found[f"{name}_growth_percent"] = max(0.0, 100.0 * (late / early - 1.0))
        return found
