"""The composition root: builds every part of the service, starts and stops them in order."""

import asyncio
import gc
import json
import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from softarm.common.real_time import raise_priority
from softarm.daemon.config import Setup
from softarm.daemon.control.command_server import CommandServer
from softarm.daemon.control.dependencies import LoopDependencies
from softarm.daemon.control.host_watch import HostWatch
from softarm.daemon.control.instruments import Instruments, LiveInstruments
from softarm.daemon.control.off_loop import off_loop
from softarm.daemon.control.readings import Readings
from softarm.daemon.control.recorder import RecorderError
from softarm.daemon.control.replay import ReplayedInstruments
from softarm.daemon.control.tick import Ticker
from softarm.daemon.estimation.messages import EstimationRequest, EstimationResult
from softarm.daemon.estimation.solver import SolverSettings
from softarm.daemon.estimation.worker import NICER, Worker
from softarm.daemon.loop import ControlLoop
from softarm.daemon.network.bus import Bus
from softarm.daemon.network.inbox import serve_each
from softarm.daemon.network.schemas import schemas
from softarm.daemon.notify import Notifier
from softarm.estimator.recording import Recording
from softarm.estimator.rotations import from_quaternions, to_quaternions
from softarm_client.messages import Surface

logger = logging.getLogger(__name__)
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
CLOSE_RECORDING_S = 5.0
"""At the end the service waits so long for the disk; what was written stays in the ``.part``."""


@dataclass(frozen=True)
class Replay:
    """A recording to play instead of the instruments.

    Args:
        recording: What to play.
        speed: Factor on the recorded time.
    """

    recording: Recording
    speed: float

    @property
    def base(self) -> str:
        """Channel of the base's pose, empty when the recording has none."""
        return "base" if "base" in self.recording.frames else ""


class Service:
    """One arm: the control loop with its instruments, its estimator's process and its network.

    Args:
        setup: The checked configuration.
        notifier: Speaks to systemd.
        replay: A recording to play instead of the instruments.
    """

    def __init__(self, setup: Setup, notifier: Notifier, replay: Replay | None = None) -> None:
        self._setup = setup
        self._notifier = notifier
        self._replay = replay
        config = setup.config
        self._stopping = asyncio.Event()
        self._host = HostWatch(config.recording_directory)
        self._bus = Bus(config.network, config.arm, asyncio.get_running_loop())
        self._loop = ControlLoop(
            setup,
            LoopDependencies(
                self._make_instruments,
                self._make_estimator,
                self._bus,
                config.base_body if replay is None else replay.base,
                lambda: notifier.ready(f"serving {config.arm}"),
                host=lambda: self._host.newest,
            ),
        )

    def _make_instruments(self, readings: Readings) -> Instruments:
        if self._replay is None:
            return LiveInstruments(self._setup, readings.on_reading)
        return ReplayedInstruments(
            self._replay.recording,
            self._setup.config.sensors,
            len(self._setup.specimen.chambers),
            self._replay.speed,
            readings.put,
            self.stop,
        )

    def _make_estimator(
        self, on_result: Callable[[EstimationResult], None]
    ) -> Worker[EstimationRequest, EstimationResult]:
        config = self._setup.config
        # A gauge is shown beside the estimated force; as a measurement it would be the force itself.
        sensors = tuple(sensor for sensor in config.sensors if sensor.kind != "gauge")
        self._worker = Worker[EstimationRequest, EstimationResult](
            SolverSettings(self._setup.specimen, sensors, config.control),
            on_result,
            self._take_surface,
            nicer=NICER if config.control.model == "fem" else 0,  # the rod leaves most of a core free
        )
        return self._worker

    def _take_surface(self, surface: Surface) -> None:
        """Pass the surface, which comes from the estimator's process, to clients and recordings."""
        self._bus.provide("surface", surface.model_dump_json().encode())
        self._loop.record_surface(surface.triangles)

    async def run(self) -> None:
        """Serve until a signal or ``stop``; every way out vents the arm before it waits for anything."""
        to_quaternions(from_quaternions(UPRIGHT))  # loads compiled code, for which no tick can wait
        server = CommandServer(self._bus, self._loop)
        with self._host, self._bus:
            # The arm is claimed before anything touches it: a second service for it ends here.
            self._bus.open(self._documents(), server.stop)
            self._announce()
            async with self._worker:  # ended last: its process may need seconds to end
                try:
                    async with asyncio.TaskGroup() as tasks:
                        background = [
                            tasks.create_task(self._loop.instruments.connect()),
                            tasks.create_task(serve_each(self._bus.next_call, server.serve, tasks)),
                        ]
                        try:
                            await self._control()
                        finally:  # before the group waits for commands that wait for a disk
                            self._notifier.stopping()
                            self._loop.shut_down()
                        for task in background:
                            task.cancel()  # or the group would wait for them for ever
                finally:
                    await self._close()

    def stop(self) -> None:
        """Request the end of the service."""
        self._stopping.set()

    def _announce(self) -> None:
        """Log what is served, once the address is ours."""
        config = self._setup.config
        logger.info(
            "serving %s at %s: specimen %s, model %s, devices %s; the estimator is being built",
            config.arm,
            ", ".join(config.network.listen or config.network.connect),
            config.specimen,
            config.control.model,
            ", ".join(device.name for device in self._setup.devices),
        )

    async def _close(self) -> None:
        """Close the devices, then the recording, which waits for the disk."""
        await self._loop.instruments.close()
        if self._loop.recorder.path is not None:
            try:
                await asyncio.wait_for(off_loop(self._loop.recorder.stop), CLOSE_RECORDING_S)
            except (RecorderError, TimeoutError) as error:
                logger.warning("the recording was not closed: %s", error or "the disk does not answer")

    async def _control(self) -> None:
        # A later collection of all that has been built would take longer than a tick.
        gc.collect()
        gc.freeze()
        raise_priority()  # the estimator and the network's threads have been started and are not real-time
        stopped = asyncio.create_task(self._stopping.wait())
        with Ticker(1.0 / self._setup.config.control.rate_hz) as ticker:
            async for tick in ticker.ticks():
                self._loop.step(tick)
                # Only here: a loop that hangs or whose step raises is no longer alive for systemd.
                self._notifier.watchdog(self._worker.state.starting)
                if stopped.done():
                    return

    def _documents(self) -> dict[str, bytes | None]:
        """Write what clients may query, once: zenoh's threads then only copy bytes."""
        config, specimen = self._setup.config, self._setup.specimen
        return {
            "config": config.model_dump_json().encode(),
            "specimen": specimen.model_dump_json(by_alias=True).encode(),
            "surface": None,  # until the estimator's process, which has the mesh, brings it
            "schema": json.dumps(schemas()).encode(),
        }
