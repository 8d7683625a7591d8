"""An arm in one process and accelerated time: real fakes, drivers, guard, controller and commands.

Only the estimator is stood in for: it answers whenever a sensor speaks, as its process does, with pressures
that hold the pose.
"""

import asyncio
import contextlib
import dataclasses
import json
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from softarm.api.commands import VERBS, Applied, Refused
from softarm.cli import fakes
from softarm.daemon.config import ServiceConfig, Setup
from softarm.daemon.control.controller import Controller
from softarm.daemon.control.guard import Guard, Watched
from softarm.daemon.control.instruments import LiveInstruments
from softarm.daemon.control.knowledge import Knowledge
from softarm.daemon.control.poses import PoseStore
from softarm.daemon.control.readings import Readings
from softarm.daemon.control.recorder import Recorder
from softarm.daemon.control.verbs import Context, Verbs
from softarm.daemon.estimation.messages import EstimationRequest, EstimationResult, HoldAnswer
from softarm.daemon.safety.checks import ALL_CHECKS
from softarm.daemon.safety.findings import FindingBook
from softarm.daemon.safety.modes import PRESSURISED, Event, Mode
from softarm.daemon.safety.observation import Estimator
from softarm.drivers.registry import load_devices
from softarm.drivers.valves.alarms import reports_fault
from softarm.estimator.arm import default_loads
from softarm.estimator.specimen import load_specimen
from softarm.experiments.rig import RigSettings, service_config

VALVE_MAP = (3, 2, 1, 0, 4, 5)
TICK_S = 0.01
LEASE_EVERY = 20
HELD_PA = 20e3
PLAYED_PA = 15e3
NANOSECONDS = 1e9
WELL_S = 30.0


def clock_ns() -> int:
    """Read the time of the running loop [ns]."""
    return round(asyncio.get_running_loop().time() * NANOSECONDS)


class SafetyArm:
    """The control side of a service on a running bench of fakes.

    Args:
        rig: The bench.
        folder: Takes poses and recordings.
    """

    def __init__(self, rig: Any, folder: Path) -> None:
        setup = _setup(rig)
        config, specimen = setup.config, setup.specimen
        self.rig = rig
        self.readings = Readings(config.sensors, config.base_body, config.safety, lambda _name, _sample: None)
        self.instruments = LiveInstruments(setup, self.readings.take, clock_ns)
        self.limits = np.array(specimen.pressure_limits)
        self.controller = Controller(self.instruments.valves, self.limits, config.control, config.safety)
        names = tuple(section.name for section in specimen.sections)
        self.knowledge = Knowledge(names, default_loads(specimen), self.readings.rest)
        recorder = Recorder(folder / "recordings")
        self.guard = Guard(
            Watched(
                self.instruments,
                self.readings,
                self.controller,
                self.knowledge,
                FindingBook(ALL_CHECKS),
                self._estimator,
                recorder.health,
                config.safety.valve_deadline_s,
                lambda _finding, _new: None,
            )
        )
        poses = PoseStore(folder / "poses.json")
        blocking = lambda mode: self.guard.blocking(mode, clock_ns())  # noqa: E731
        self.verbs = Verbs(
            Context(self.controller, self.knowledge, recorder, poses, {}, blocking, clock_ns, lambda: 10**18)
        )
        self.estimator_runs = True
        self.estimates_since_ns = 0
        self.chamber_pa = PLAYED_PA
        self._estimator_deadline_s = config.safety.estimator_deadline_s
        self._sections = len(names)
        self._loads = len(default_loads(specimen))
        self.blind = False
        self._estimated_ns: int | None = None
        self._lease = ""
        self._sequence = 0

    @property
    def mode(self) -> Mode:
        """The present mode."""
        return self.controller.modes.mode

    @property
    def setpoints(self) -> list[int]:
        """What the fake terminal holds for its valves [mbar]."""
        (port,) = self.rig.valve_ports.values()
        return [port.node.setpoint(valve) for valve in VALVE_MAP]

    def _estimator(self, now_ns: int) -> Estimator:
        age_s = None if self._estimated_ns is None else (now_ns - self._estimated_ns) / NANOSECONDS
        return Estimator(self.estimator_runs, age_s, self._estimator_deadline_s)

    def _estimate(self, now_ns: int) -> None:
        snapshot = self.readings.snapshot(now_ns)
        if not self.estimator_runs or not snapshot.used:
            return
        self._estimated_ns = now_ns
        request = EstimationRequest(
            snapshot.time_s, snapshot.newest_arrival_ns, snapshot.readings, self.limits, np.zeros(3)
        )
        self.knowledge.take(
            EstimationResult(
                request,
                converged=True,
                loads=np.zeros(self._loads),
                load_covariance=np.eye(self._loads),
                positions=np.zeros((self._sections, 3)),
                quaternions=np.tile([1.0, 0.0, 0.0, 0.0], (self._sections, 1)),
                frame_std=np.zeros((self._sections, 6)),
                innovation_squared=1.0,
                degrees_of_freedom=1.0,
                hold=HoldAnswer(np.full(len(self.limits), HELD_PA), reachable=True, note=""),
            ),
            now_ns,
        )

    async def send(self, verb: str, **fields: object) -> Applied | Refused:
        """Send a command as a client would, past the network."""
        self._sequence += 1
        request = {"deadline_unix_ns": 10**18 + 1, "sequence": self._sequence, "client": "bench"}
        if "lease" in VERBS[verb].model_fields and self._lease:
            request["lease"] = self._lease
        answer = await self.verbs.answer(verb, json.dumps(request | fields).encode())
        if verb == "lease/acquire" and isinstance(answer, Applied):
            self._lease = str(answer.applied["lease"])
        return answer

    async def run(self) -> None:
        """Tick, renew the lease and the set-point, for ever."""
        ticks = 0
        while True:
            now_ns = clock_ns()
            if ticks % LEASE_EVERY == 0:
                await self._renew()
            self.guard.advance(now_ns, TICK_S)
            self._estimate(now_ns)
            self.guard.check(now_ns, now_ns)
            self.blind = self.blind or self._misses_a_pose(now_ns)
            ticks += 1
            await asyncio.sleep(TICK_S)

    def _misses_a_pose(self, now_ns: int) -> bool:
        return any(entry.needed and entry.stale for entry in self.readings.inputs(now_ns, {}))

    async def _renew(self) -> None:
        answer = await self.send("lease/acquire")
        if isinstance(answer, Refused):
            self._lease = ""
        if self.mode in (Mode.ARMED, Mode.EXPERIMENT):
            await self.send("set_pressures", pressures_pa=self._played(), lifetime_s=1.0)

    def _played(self) -> list[float]:
        return [self.chamber_pa] * len(self.limits)

    async def enter(self, mode: Mode) -> None:
        """Lead the arm from wherever it is into a mode, with pressure where the mode allows it.

        Raises:
            AssertionError: A command on the way was refused.
        """
        await self._renew()
        if self.mode is Mode.STARTING and mode is not Mode.STARTING:
            self.controller.fire(Event.READY, "bench")
        elif self.mode is Mode.FAULTED and mode is not Mode.FAULTED:
            await self.demand("clear")
        elif self.mode in PRESSURISED:
            await self.demand("disarm")
        if mode is Mode.STOPPING and self.mode is not Mode.STOPPING:
            self.controller.fire(Event.SHUT_DOWN, "bench")
        played = {"pressures_pa": self._played(), "lifetime_s": 1.0}
        fields: Mapping[str, Mapping[str, object]] = {
            "set_pressures": played,
            "teach/hold": {"ramp_s": RAMP_S},
        }
        for verb in ENTER[mode]:
            await self.demand(verb, **fields.get(verb, {}))
        await asyncio.sleep(ENTER_S if mode in PRESSURISED else 0.1)

    async def demand(self, verb: str, **fields: object) -> None:
        """Send a command that must be accepted."""
        answer = await self.send(verb, **fields)
        assert isinstance(answer, Applied), f"{verb}: {answer}"

    async def until_well(self) -> bool:
        """Wait until nothing keeps the arm from any mode; tell whether that came to be."""
        deadline = asyncio.get_running_loop().time() + WELL_S
        while self.guard.blocking(Mode.HOLDING, clock_ns()) or not self._can_arm():
            if asyncio.get_running_loop().time() > deadline:
                return False
            await asyncio.sleep(0.05)
        return True

    @property
    def error_kept(self) -> bool:
        """Whether the terminal keeps an error until it is acknowledged."""
        bank = self.instruments.valves
        return bank.layout.keeps_errors and reports_fault(bank.health.alarms)

    async def acknowledge(self) -> None:
        """Have kept errors acknowledged: by command, or where the mode takes none as the next start would."""
        if self.mode in (Mode.IDLE, Mode.FAULTED):
            await self.demand("clear")
        else:
            self.controller.acknowledge()

    def _can_arm(self) -> bool:
        return not self.instruments.valve_alarms()[0] and not self.instruments.valve_alarms()[1]


ENTER_S = 0.6
RAMP_S = 0.3
ENTER: Mapping[Mode, Sequence[str]] = {
    Mode.STARTING: (),
    Mode.STOPPING: (),
    Mode.IDLE: (),
    Mode.FAULTED: ("stop",),
    Mode.ARMED: ("arm", "set_pressures"),
    Mode.TEACH: ("arm", "set_pressures", "teach/start"),
    Mode.HOLDING: ("arm", "set_pressures", "teach/start", "teach/hold"),
    Mode.EXPERIMENT: ("arm", "experiment/begin", "set_pressures"),
}
"""Commands that lead from IDLE into a mode; the service itself begins and ends."""


def _setup(rig: Any) -> Setup:
    announced = [dataclasses.asdict(endpoint) for endpoint in rig.endpoints()]
    settings = RigSettings(Path("-"), sensors=("orientation", "bend", "imu"))
    table = service_config(settings, announced)
    config = ServiceConfig.model_validate(table)
    return Setup(Path("-"), "", config, load_specimen("sopra"), load_devices(table["devices"]))


@contextlib.asynccontextmanager
async def safety_arm(kinds: Mapping[str, str], folder: Path) -> AsyncIterator[SafetyArm]:
    """Run fakes and the control side on them for the length of a block, all devices connected.

    Args:
        kinds: Kind of each device by its name; one of them a valve terminal.
        folder: Takes poses and recordings.
    """
    devices = [{"name": name, "kind": kind, **FAKE.get(kind, {})} for name, kind in kinds.items()]
    table = {"control_port": None, "plant": {"kind": "still"}, "device": devices}
    async with fakes.bench(table) as rig:
        arm = SafetyArm(rig, folder)
        ticking = asyncio.create_task(arm.run(), name="ticks")
        try:
            await arm.instruments.connect()
            yield arm
        finally:
            ticking.cancel()
            await asyncio.wait({ticking})
            await arm.instruments.close()
            if not ticking.cancelled():
                ticking.result()


FAKE: Mapping[str, Mapping[str, Any]] = {
    "festo_mpa": {"valve_map": VALVE_MAP},
    "festo_vtem": {"valve_map": VALVE_MAP},
    "bendlabs": {"boot_s": 0.3},
    "witmotion": {"baud": 115200},
}
"""How a fake is set up where the defaults do not do."""
