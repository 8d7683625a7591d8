"""A running rig: the world, the fakes on their ports, and the faults of the scenario."""

import asyncio
import contextlib
import errno
import functools
import tempfile
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from softarm.estimator.errors import InputError
from softarm.fakes.clock import Clock
from softarm.fakes.devices import (
    DeviceSurroundings,
    build_instrument,
    build_measurement,
    build_node,
    catalogue,
    seed_of,
)
from softarm.fakes.faults import FaultBoard, Value
from softarm.fakes.parts import (
    BendPart,
    DevicePart,
    InertialPart,
    QtmPart,
    QuaternionLinePart,
    SerialPart,
    ValvesPart,
)
from softarm.fakes.placement import with_placed_instruments
from softarm.fakes.plant.effects import INSTRUMENT_EFFECTS
from softarm.fakes.plant.state import Cord, Plant, PlantState
from softarm.fakes.plants import build_plant
from softarm.fakes.qtm.discovery import Discovery
from softarm.fakes.qtm.server import QtmServer
from softarm.fakes.scenario import FaultPart, Scenario
from softarm.fakes.serial.port import SerialPort
from softarm.fakes.signals import ConcealedSignals
from softarm.fakes.valves.server import ModbusPort
from softarm.fakes.world import FakeArmWorld, run_world


@dataclass(frozen=True)
class Endpoint:
    """Where a fake can be reached.

    Args:
        name: Name of the device.
        source: Address as the readings of a driver are to name it.
        host: Address of its TCP port; empty for a serial device.
        port: Its TCP port; 0 for a serial device.
        path: Link to its terminal; empty for a TCP device.
        discovery_port: UDP port of its discovery, if it has one.
        sections: Section of each body, of an inertial unit, and under each bend sensor from the base; empty
            for a bend sensor on the bench.
        valve_map: Valve of each chamber of a valve terminal.
    """

    name: str
    kind: str
    source: str
    host: str = ""
    port: int = 0
    path: str = ""
    discovery_port: int | None = None
    sections: tuple[str, ...] = ()
    valve_map: tuple[int, ...] = ()


class Rig:
    """The fakes of a scenario."""

    def __init__(self, scenario: Scenario, clock: Clock, runtime_dir: Path) -> None:
        self.clock = clock
        mounted = build_plant(scenario.plant, scenario.seed)
        self.plant: Plant = mounted.plant
        self.scenario = scenario = with_placed_instruments(scenario, self.plant)
        self.boards = {part.name: FaultBoard(part.name, catalogue(part)) for part in scenario.device}
        self.signals = ConcealedSignals()
        self.valve_ports: dict[str, ModbusPort] = {}
        self.qtm_servers: dict[str, QtmServer] = {}
        self.serial_ports: dict[str, SerialPort] = {}
        self._runtime_dir = runtime_dir
        self._discoveries: dict[str, asyncio.DatagramTransport] = {}
        self._tasks: asyncio.TaskGroup | None = None
        self._ends: dict[tuple[str, str], float] = {}
        self.world = FakeArmWorld(self.plant, None, (), scenario.step_s)
        around = DeviceSurroundings(self.plant, scenario.seed, self.signals.apply, mounted.misalignments)
        for part in scenario.device:
            self._build(part, around)
        for effect, value in scenario.plant.switches.items():
            self.switch(effect, value)
        if scenario.cord is not None:
            cord = scenario.cord
            self.world.tie(Cord(cord.section, cord.hook_m, cord.length_m))
        # Checked now: a scripted fault with a wrong name must not end the rig in the middle of a run.
        for fault in scenario.fault:
            self.boards[fault.device].check(fault.fault, fault.parameters, fault.times)

    @property
    def state(self) -> PlantState:
        """The latest snapshot of the arm."""
        return self.world.state

    async def run(self, ready: asyncio.Event) -> None:
        """Open every port, then serve until cancelled."""
        try:
            for part in self.scenario.device:
                await self._open(part)
            async with asyncio.TaskGroup() as tasks:
                self._tasks = tasks
                tasks.create_task(run_world(self.world, self.clock), name="world")
                for name, server in self.qtm_servers.items():
                    tasks.create_task(server.run(), name=name)
                for name, port in self.serial_ports.items():
                    tasks.create_task(port.run(), name=name)
                for fault in self.scenario.fault:
                    tasks.create_task(self._script(fault), name=f"fault {fault.device}.{fault.fault}")
                ready.set()
        finally:
            await self._close()

    def switch(self, effect: str, value: object) -> None:
        """Set a concealed effect of the arm, of the valves or of a sensor.

        Raises:
            InputError: There is no such effect, or the value does not fit it.
        """
        if effect in INSTRUMENT_EFFECTS:
            self.signals.switch(effect, value)
        else:
            self.plant.switch(effect, value)

    def inject(
        self,
        device: str,
        fault: str,
        parameters: Mapping[str, Value] | None = None,
        times: int = 1,
        for_s: float | None = None,
    ) -> None:
        """Switch a fault on.

        Args:
            device: Name of the device.
            fault: Name of the fault.
            parameters: Those that differ from its defaults.
            times: How often a fault occurs that occurs a number of times.
            for_s: Time after which it is switched off [s]; it stays when left out.

        Raises:
            InputError: The fault or a parameter is unknown.
        """
        self.boards[device].set(fault, parameters, times)
        self._ends.pop((device, fault), None)
        if for_s is not None and self._tasks is not None:
            until = self._ends[device, fault] = self.clock.now() + for_s
            self._tasks.create_task(self._clear_at(device, fault, until), name=f"clear {device}.{fault}")

    def endpoints(self) -> list[Endpoint]:
        """Return where each fake can be reached, in the order of the scenario."""
        return [self._endpoint(part) for part in self.scenario.device]

    def _endpoint(self, part: DevicePart) -> Endpoint:
        if isinstance(part, ValvesPart):
            valves = self.valve_ports[part.name]
            source = f"fake+modbus+tcp://{valves.host}:{valves.port}"
            return Endpoint(part.name, part.kind, source, valves.host, valves.port, valve_map=part.valve_map)
        if isinstance(part, QtmPart):
            server = self.qtm_servers[part.name]
            source = f"fake+qtm://{server.host}:{server.port}"
            discovery = self._discoveries.get(part.name)
            number = discovery.get_extra_info("sockname")[1] if discovery else None
            bodies = tuple(body.section for body in part.bodies)
            return Endpoint(part.name, part.kind, source, server.host, server.port, "", number, bodies)
        assert isinstance(part, SerialPart)
        link = str(self.serial_ports[part.name].link)
        sections: tuple[str, ...] = ()
        if isinstance(part, BendPart):
            sections = self._sections_under(part)
        elif isinstance(part, QuaternionLinePart):
            sections = part.sections
        elif isinstance(part, InertialPart):
            sections = (part.section,)
        return Endpoint(part.name, part.kind, f"fake+serial://{link}", path=link, sections=sections)

    def _sections_under(self, part: BendPart) -> tuple[str, ...]:
        """Name the section at the far end of the segment under each bend sensor, from the base."""
        below = dict(zip(self.plant.segments, self.plant.sections[1:], strict=True))
        return tuple(below[segment] if segment else "" for segment in reversed(part.sensors))

    def _build(self, part: DevicePart, around: DeviceSurroundings) -> None:
        board, scenario = self.boards[part.name], self.scenario
        if isinstance(part, ValvesPart):
            node = build_node(part, around, board)
            self.world = FakeArmWorld(self.plant, node, part.valve_map, scenario.step_s)
            self.valve_ports[part.name] = ModbusPort(part, node, board, self.clock, scenario.host)
        elif isinstance(part, QtmPart):
            measurement = build_measurement(part, around, board)
            self.qtm_servers[part.name] = QtmServer(
                part, measurement, lambda: self.state, board, self.clock, scenario.host
            )
        elif isinstance(part, SerialPart):
            link = part.link or self._runtime_dir / part.name
            instrument = build_instrument(part, around, board)
            line_seed = seed_of(scenario.seed, f"{part.name}/line")
            self.serial_ports[part.name] = SerialPort(
                instrument, link, lambda: self.state, self.clock, line_seed
            )

    async def _open(self, part: DevicePart) -> None:
        """Open the ports of one device.

        Raises:
            InputError: One of them cannot be had.
        """
        try:
            if isinstance(part, ValvesPart):
                await self.valve_ports[part.name].start()
            elif isinstance(part, QtmPart):
                await self._open_qtm(part)
            else:
                self._plug(self.serial_ports[part.name])
        except OSError as error:
            where, reason = f"scenario, device {part.name}", error.strerror or str(error)
            raise InputError(
                where, reason.lower(), "choose another port or link; port 0 takes a free one"
            ) from None

    def _plug(self, port: SerialPort) -> None:
        if port.link.exists() and not port.link.is_symlink():
            raise FileExistsError(errno.EEXIST, f"{port.link} is in the way")
        port.plug()

    async def _open_qtm(self, part: QtmPart) -> None:
        server = self.qtm_servers[part.name]
        await server.start()
        if part.discovery_port is not None:
            transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(
                functools.partial(Discovery, server.port - 1),
                local_addr=(self.scenario.host, part.discovery_port),
            )
            self._discoveries[part.name] = transport

    async def _close(self) -> None:
        for valves in self.valve_ports.values():
            await valves.stop()
        for server in self.qtm_servers.values():
            await server.stop()
        for transport in self._discoveries.values():
            transport.close()
        for port in self.serial_ports.values():
            port.unplug()
        await asyncio.sleep(0)

    async def _script(self, fault: FaultPart) -> None:
        await self.clock.sleep_until(fault.at_s)
        self.inject(fault.device, fault.fault, fault.parameters, fault.times, fault.for_s)

    async def _clear_at(self, device: str, fault: str, until: float) -> None:
        """Clear a fault at its end, unless another end has been set meanwhile."""
        await self.clock.sleep_until(until)
        if self._ends.get((device, fault)) == until:
            self.boards[device].clear(fault)


@contextlib.asynccontextmanager
async def running(scenario: Scenario) -> AsyncIterator[Rig]:
    """Run the fakes of a scenario for the length of a block.

    Raises:
        InputError: The scenario names something that does not exist.
    """
    with contextlib.ExitStack() as folders:
        folder = scenario.runtime_dir
        if folder is None:
            folder = Path(folders.enter_context(tempfile.TemporaryDirectory(prefix="softarm-fakes-")))
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                "scenario, runtime_dir", f"{folder}: {error.strerror}", "name a folder"
            ) from None
        clock = Clock()
        rig = Rig(scenario, clock, folder)
        clock.restart()  # building the arm takes seconds, which the scenario's times do not count
        ready = asyncio.Event()
        serving = asyncio.create_task(rig.run(ready), name="fakes")
        serving.add_done_callback(lambda _: ready.set())
        try:
            await ready.wait()
            if not serving.done():
                yield rig
        finally:
            serving.cancel()
            await asyncio.wait({serving})
        if not serving.cancelled():
            serving.result()
