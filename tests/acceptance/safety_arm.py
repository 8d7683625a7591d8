"""An arm in one process and accelerated time: real fakes, drivers, control loop and estimator.

The estimator's solver runs in this process and answers after a virtual time, as its process does.
"""

import asyncio
import contextlib
import dataclasses
import json
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from softarm.daemon.config import ServiceConfig, Setup
from softarm.daemon.control.channels import channel_readings
from softarm.daemon.control.dependencies import Clocks, LoopDependencies
from softarm.daemon.control.instruments import LiveInstruments
from softarm.daemon.control.readings import Readings, channel
from softarm.daemon.control.tick import TickSchedule
from softarm.daemon.estimation.messages import EstimationRequest, EstimationResult
from softarm.daemon.estimation.solver import Solver, SolverSettings
from softarm.daemon.estimation.worker import WorkerState
from softarm.daemon.loop import ControlLoop
from softarm.daemon.safety.modes import PRESSURISED, Mode
from softarm.drivers.reading import Reading
from softarm.drivers.registry import load_devices
from softarm.drivers.valves.alarms import reports_fault
from softarm.estimator.specimen import load_specimen
from softarm.experiments.rig import RigSettings, service_config
from softarm.fakes.rig import running
from softarm.fakes.scenario import check_scenario
from softarm_client.commands import VERBS, Applied, Refused
from softarm_client.messages import Message

VALVE_MAP = (3, 2, 1, 0, 4, 5)
TICK_S = 0.01
LEASE_EVERY = 20
PLAYED_PA = 15e3
NANOSECONDS = 1e9
WELL_S = 30.0
SOLVE_S = 0.08
"""Virtual time of one estimate: that of a machine on which another program computes."""
UNIX_NS = 10**18


def clock_ns() -> int:
    """Read the time of the running loop [ns]."""
    return round(asyncio.get_running_loop().time() * NANOSECONDS)


class InlineEstimator:
    """The service's solver with the mailbox of its process, in this process and in virtual time.

    Args:
        settings: What the solver is built from.
        on_result: Takes each result.
    """

    state = WorkerState(running=True, restarts=0, gave_up=False)

    def __init__(self, settings: SolverSettings, on_result: Callable[[EstimationResult], None]) -> None:
        self._solver = Solver(settings)
        self._on_result = on_result
        self._busy = False
        self._waiting: Callable[[], EstimationRequest | None] | None = None

    def submit(self, make: Callable[[], EstimationRequest | None]) -> None:
        """Solve a request; one that comes meanwhile waits, and is replaced by a newer one."""
        if self._busy:
            self._waiting = make
            return
        self._waiting, request = None, make()
        if request is None:
            return
        self._busy = True
        asyncio.get_running_loop().call_later(SOLVE_S, self._answer, self._solver(request))

    def watch(self) -> None:
        """Do nothing: it answers always."""

    def close(self) -> None:
        """End the solver's threads."""
        self._solver.close()

    def _answer(self, result: EstimationResult) -> None:
        self._busy = False
        self._on_result(result)
        self._solver.finish()
        asyncio.get_running_loop().call_soon(self._submit_waiting)

    def _submit_waiting(self) -> None:
        if self._waiting is not None and not self._busy:
            self.submit(self._waiting)


class Silence:
    """An outlet that nobody listens to."""

    shape_wanted = False

    def publish(self, stream: str, message: Message) -> None:
        """Drop the message."""

    def publish_shape(self, nodes: bytes) -> None:
        """Drop the shape."""


class PoseGaps:
    """Measures how long poses were away, from the drivers' readings and not from the service's flags.

    Args:
        channels: Channels of the poses that the modes need.
    """

    def __init__(self, channels: Sequence[str]) -> None:
        self._last_ns = dict.fromkeys(channels, 0)
        self._longest_ns = 0

    def take(self, reading: Reading[Any]) -> None:
        """Take a reading of any device."""
        for entry in channel_readings(reading):
            name = entry.device
            if name in self._last_ns:
                self._longest_ns = max(self._longest_ns, entry.host_monotonic_ns - self._last_ns[name])
                self._last_ns[name] = entry.measured_ns

    def begin(self) -> None:
        """Forget the gaps so far."""
        self._longest_ns = 0

    @property
    def longest_s(self) -> float:
        """Greatest age that the newest pose of a channel has reached since ``begin`` [s]."""
        ages = [clock_ns() - last_ns for last_ns in self._last_ns.values()]
        return max([self._longest_ns, *ages]) / NANOSECONDS


class SafetyArm:
    """The control loop of a service on a running bench of fakes.

    Args:
        rig: The bench.
        folder: Takes poses and recordings.
    """

    def __init__(self, rig: Any, folder: Path) -> None:
        self.rig = rig
        self._setup = _setup(rig, folder)
        config = self._setup.config
        self.deadline_s = config.safety.sensor_deadline_s
        self.gaps = PoseGaps([channel(sensor) for sensor in config.sensors if sensor.needed])
        self.loop = ControlLoop(
            self._setup,
            LoopDependencies(
                self._instruments,
                self._estimator,
                Silence(),
                config.base_body,
                lambda: None,
                Clocks(clock_ns, lambda: UNIX_NS),
            ),
        )
        self.chamber_pa = PLAYED_PA
        self._lease = ""
        self._sequence = 0

    def _instruments(self, readings: Readings) -> LiveInstruments:
        def take(reading: Reading[Any]) -> None:
            self.gaps.take(reading)
            readings.on_reading(reading)

        self.instruments = LiveInstruments(self._setup, take, clock_ns)
        return self.instruments

    def _estimator(self, on_result: Callable[[EstimationResult], None]) -> InlineEstimator:
        config = self._setup.config
        sensors = tuple(sensor for sensor in config.sensors if sensor.kind != "gauge")
        settings = SolverSettings(self._setup.specimen, sensors, config.control)
        self.estimator = InlineEstimator(settings, on_result)
        return self.estimator

    @property
    def mode(self) -> Mode:
        """The present mode."""
        return self.loop.mode

    @property
    def setpoints(self) -> list[int]:
        """What the fake terminal holds for its valves [mbar]."""
        (port,) = self.rig.valve_ports.values()
        return [port.node.setpoint(valve) for valve in VALVE_MAP]

    async def send(self, verb: str, **fields: object) -> Applied | Refused:
        """Send a command as a client would, past the network."""
        self._sequence += 1
        request = {"deadline_unix_ns": UNIX_NS + 1, "sequence": self._sequence, "client": "bench"}
        if "lease" in VERBS[verb].model_fields and self._lease:
            request["lease"] = self._lease
        answer = await self.loop.answer(verb, json.dumps(request | fields).encode())
        if verb == "lease/acquire" and isinstance(answer, Applied):
            self._lease = str(answer.applied["lease"])
        return answer

    async def run(self) -> None:
        """Step the loop, renew the lease and the set-point, for ever."""
        interval_ns = round(TICK_S * NANOSECONDS)
        schedule = TickSchedule(clock_ns() + interval_ns, interval_ns)
        while True:
            await asyncio.sleep(max(0.0, (schedule.next_deadline_ns - clock_ns()) / NANOSECONDS))
            tick = schedule.begin_tick(clock_ns())
            if tick.index % LEASE_EVERY == 0:
                await self._renew()
            self.loop.step(tick)

    async def _renew(self) -> None:
        answer = await self.send("lease/acquire")
        if isinstance(answer, Refused):
            self._lease = ""
        if self.mode in (Mode.ARMED, Mode.EXPERIMENT):
            await self.send("set_pressures", pressures_pa=self._played(), lifetime_s=1.0)

    def _played(self) -> list[float]:
        return [self.chamber_pa] * len(self._setup.specimen.chambers)

    async def enter(self, mode: Mode) -> None:
        """Lead the arm from where it is into a pressurised mode, with pressure in its chambers.

        An arm that a fault has left in the mode, as it should, stays there.

        Raises:
            AssertionError: A command on the way was refused, or the chambers hold no pressure.
        """
        await self._renew()
        if self.mode is not mode:
            await self._change(mode)
        assert self.mode is mode, self.loop.controller.modes.fault_cause
        assert any(self.setpoints), f"no pressure in {mode}"

    async def _change(self, mode: Mode) -> None:
        if self.mode is Mode.FAULTED:
            await self.demand("clear")
        elif self.mode in PRESSURISED:
            await self.demand("disarm")
        for verb in ENTER[mode]:
            await self._before(verb)
            await self.demand(verb, **self._fields(verb))
        await asyncio.sleep(ENTER_S)

    async def _before(self, verb: str) -> None:
        """Wait for what a command needs: the pressures of a hold come with an estimate under pressure."""
        if verb != "teach/hold":
            return
        await asyncio.sleep(ENTER_S)
        deadline = asyncio.get_running_loop().time() + WELL_S
        while self.loop.estimator_state.held is None:
            assert asyncio.get_running_loop().time() < deadline, "no pressures would hold the pose"
            await asyncio.sleep(TICK_S)

    def _fields(self, verb: str) -> Mapping[str, object]:
        match verb:
            case "set_pressures":
                return {"pressures_pa": self._played(), "lifetime_s": 1.0}
            case "teach/hold":
                return {"ramp_s": RAMP_S}
        return {}

    async def demand(self, verb: str, **fields: object) -> None:
        """Send a command that must be accepted."""
        answer = await self.send(verb, **fields)
        assert isinstance(answer, Applied), f"{verb}: {answer}"

    async def until_well(self) -> bool:
        """Wait until nothing keeps the arm from any mode; return whether that came to be."""
        deadline = asyncio.get_running_loop().time() + WELL_S
        while self.loop.safety.blocking(Mode.HOLDING, clock_ns()) or not self._can_arm():
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
            self.loop.controller.acknowledge()

    def _can_arm(self) -> bool:
        return not self.instruments.valve_alarms()[0] and not self.instruments.valve_alarms()[1]


ENTER_S = 0.6
RAMP_S = 0.3
ENTER: Mapping[Mode, Sequence[str]] = {
    Mode.ARMED: ("arm", "set_pressures"),
    Mode.TEACH: ("arm", "set_pressures", "teach/start"),
    Mode.HOLDING: ("arm", "set_pressures", "teach/start", "teach/hold"),
    Mode.EXPERIMENT: ("arm", "experiment/begin", "set_pressures"),
}
"""Commands that lead from IDLE into each mode in which the chambers hold pressure."""


def _setup(rig: Any, folder: Path) -> Setup:
    announced = [dataclasses.asdict(endpoint) for endpoint in rig.endpoints()]
    # The rod, as its solve ends within a tick of virtual time and needs no second thread for its factor.
    settings = RigSettings(Path("-"), sensors=("orientation", "bend"), model="rod")
    table = service_config(settings, announced)
    folders = {"state_directory": folder, "recording_directory": folder / "recordings"}
    config = ServiceConfig.model_validate(table | folders)
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
    async with running(check_scenario(table)) as rig:
        arm = SafetyArm(rig, folder)
        ticking = asyncio.create_task(arm.run(), name="ticks")
        try:
            await arm.instruments.connect()
            yield arm
        finally:
            ticking.cancel()
            await asyncio.wait({ticking})
            await arm.instruments.close()
            arm.estimator.close()
            if not ticking.cancelled():
                ticking.result()


FAKE: Mapping[str, Mapping[str, Any]] = {
    "festo_mpa": {"valve_map": VALVE_MAP},
    "festo_vtem": {"valve_map": VALVE_MAP},
    "bendlabs": {"boot_s": 0.3},
    "witmotion": {"baud": 115200},
}
"""How a fake is set up where the defaults do not do."""
