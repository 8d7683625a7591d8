"""The control loop on stand-ins of devices and estimator, for a real page."""

import asyncio
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from softarm.client.session import NetworkSettings, listening_endpoint
from softarm.daemon.config import ServiceConfig, Setup
from softarm.daemon.control.channels import Sample
from softarm.daemon.control.surroundings import Surroundings
from softarm.daemon.control.tick import Ticker
from softarm.daemon.estimation.messages import EstimationResult, HoldAnswer
from softarm.daemon.estimation.worker import WorkerState
from softarm.daemon.loop import ControlLoop
from softarm.daemon.network.bus import Bus
from softarm.estimator.arm import default_loads
from softarm.estimator.specimen import load_specimen

TICK_S = 0.02
SPECIMEN = load_specimen("sopra")
LOADS = default_loads(SPECIMEN)


CONFIG = {
    "arm": "page",
    "specimen": "sopra",
    "sensors": [{"kind": "orientation", "section": "tip", "device": "qtm", "channel": "tip", "needed": True}],
    "devices": [{"name": "valves", "kind": "festo_mpa"}],
}


class Valves:
    armed = False

    def arm(self):
        self.armed = True

    def vent(self, reason):
        self.armed = False

    def acknowledge(self):
        return False

    def command(self, setpoint, lifetime_s):
        assert self.armed


class Instruments:
    """Valves that do as they are asked and a pose that does not move, fresh at every tick."""

    source, bank = "fake", "valves"

    def __init__(self, readings):
        self.valves = Valves()
        self.applied = np.zeros(6)
        self._readings = readings

    def valve_alarms(self):
        return (), ()

    def troubles(self):
        return {}

    def read(self):
        now = time.monotonic_ns()
        self._readings.put("valves", Sample((0.0,) * 6, now, now, now, 0, "fake"))
        self._readings.put("qtm/tip", Sample((0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0), now, now, now, 0, "fake"))


class Estimator:
    state = WorkerState(running=True, restarts=0, gave_up=False)

    def __init__(self, on_result):
        self.submit = lambda request: on_result(result(request))


class PageService:
    """Serves the arm ``page`` from a thread of its own."""

    def __init__(self, folder):
        self.endpoint = ""
        self.verbs_seen = []
        self._folder = folder
        self._ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)

    def __enter__(self):
        self._thread.start()
        assert self._ready.wait(20.0)
        return self

    def __exit__(self, *_):
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join()

    @property
    def mode(self):
        return self.control.mode

    def until(self, mode, within=20.0):
        deadline = time.monotonic() + within
        while self.mode != mode:
            assert time.monotonic() < deadline, f"{self.mode} instead of {mode}; {self.verbs_seen[-5:]}"
            self._stepped.wait(0.2)
            self._stepped.clear()

    async def _serve(self):
        self._loop, self._stop, self._stepped = asyncio.get_running_loop(), asyncio.Event(), threading.Event()
        folders = {"state_directory": self._folder, "recording_directory": self._folder}
        config = ServiceConfig.model_validate(CONFIG | folders)
        with Bus(NetworkSettings(listen=("tcp/127.0.0.1:0",)), "page", self._loop) as bus:
            surroundings = Surroundings(Instruments, Estimator, bus, "", lambda: None)
            self.control = ControlLoop(Setup(Path("-"), "", config, SPECIMEN, ()), surroundings)
            specimen = SPECIMEN.model_dump_json(by_alias=True).encode()
            bus.open({"specimen": lambda: specimen})
            self.endpoint = await asyncio.to_thread(listening_endpoint, bus.session)
            stepping = asyncio.create_task(self._step())
            answering = asyncio.create_task(self._answer(bus))
            self._ready.set()
            await self._stop.wait()
            for task in (stepping, answering):
                task.cancel()
            await asyncio.wait((stepping, answering))

    async def _answer(self, bus):
        while True:
            call = await bus.next_call()
            call.answer(await self.control.answer(call.verb, call.payload))
            self.verbs_seen.append(call.verb)

    async def _step(self):
        with Ticker(TICK_S) as ticker:
            async for tick in ticker.ticks():
                self.control.instruments.read()
                self.control.step(tick)
                self._stepped.set()


def result(request):
    heights = np.array([section.frame_origin_m[2] for section in SPECIMEN.sections])
    return EstimationResult(
        request,
        converged=True,
        loads=np.array([0.0, 0.0, 0.4, 0.1]),
        load_covariance=1e-3 * np.eye(4),
        positions=np.outer(heights, [0.0, 0.0, 1.0]),
        quaternions=np.tile([1.0, 0.0, 0.0, 0.0], (len(heights), 1)),
        frame_std=np.zeros((len(heights), 6)),
        innovation_squared=1.0,
        degrees_of_freedom=1.0,
        hold=HoldAnswer(np.full(6, 20e3), reachable=True, note="The pose can be reached."),
    )


@pytest.fixture
def service(tmp_path):
    with PageService(tmp_path) as running:
        yield running
