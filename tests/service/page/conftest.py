"""A service without devices or estimator for a real page: commands act on the real controller and modes."""

import asyncio
import threading
import time

import numpy as np
import pytest

from softarm.client.session import NetworkSettings, listening_endpoint
from softarm.daemon.config import ControlSettings, SafetySettings
from softarm.daemon.control.controller import Controller
from softarm.daemon.control.knowledge import Knowledge
from softarm.daemon.control.poses import PoseStore
from softarm.daemon.control.publishing import Publisher
from softarm.daemon.control.recorder import Recorder
from softarm.daemon.control.verbs import Context, Verbs
from softarm.daemon.estimation.messages import EstimationRequest, EstimationResult, HoldAnswer
from softarm.daemon.network.bus import Bus
from softarm.daemon.safety.checks import ALL_CHECKS
from softarm.daemon.safety.findings import FindingBook
from softarm.daemon.safety.modes import Event
from softarm.estimator.arm import default_loads
from softarm.estimator.specimen import load_specimen

TICK_S = 0.02
SPECIMEN = load_specimen("sopra")
LOADS = default_loads(SPECIMEN)


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
        return self.controller.modes.mode

    def until(self, mode, within=20.0):
        deadline = time.monotonic() + within
        while self.mode != mode:
            assert time.monotonic() < deadline, f"{self.mode} instead of {mode}; {self.verbs_seen[-5:]}"
            self._stepped.wait(0.2)
            self._stepped.clear()

    async def _serve(self):
        self._loop, self._stop, self._stepped = asyncio.get_running_loop(), asyncio.Event(), threading.Event()
        safety = SafetySettings()
        self.controller = Controller(Valves(), np.full(6, 65e3), ControlSettings(), safety)
        self.controller.fire(Event.READY, "test")
        self.knowledge = Knowledge(tuple(s.name for s in SPECIMEN.sections), LOADS, lambda _: ())
        self.knowledge.take(result(), 0)
        self.publisher = Publisher("fake", self.controller, self.knowledge, FindingBook(ALL_CHECKS), "fem")
        recorder, poses = Recorder(self._folder), PoseStore(self._folder / "poses.json")
        verbs = Verbs(Context(self.controller, self.knowledge, recorder, poses, {}, lambda _: ()))
        with Bus(NetworkSettings(listen=("tcp/127.0.0.1:0",)), "page", self._loop) as bus:
            specimen = SPECIMEN.model_dump_json(by_alias=True).encode()
            bus.open({"specimen": lambda: specimen})
            self.endpoint = await asyncio.to_thread(listening_endpoint, bus.session)
            ticking = asyncio.create_task(self._tick(bus))
            answering = asyncio.create_task(self._answer(bus, verbs))
            self._ready.set()
            await self._stop.wait()
            for task in (ticking, answering):
                task.cancel()
            await asyncio.wait((ticking, answering))

    async def _answer(self, bus, verbs):
        while True:
            call = await bus.next_call()
            call.answer(await verbs.answer(call.verb, call.payload))
            self.verbs_seen.append(call.verb)

    async def _tick(self, bus):
        while True:
            self.controller.tick(time.monotonic_ns(), TICK_S, self.knowledge.hold)
            asked = self.controller.asked
            bus.publish("state", self.publisher.state(asked, asked, {}, {}, 0, 0, None))
            bus.publish("estimate", self.publisher.estimate(result()))
            self._stepped.set()
            await asyncio.sleep(TICK_S)


def result():
    heights = np.array([section.frame_origin_m[2] for section in SPECIMEN.sections])
    return EstimationResult(
        EstimationRequest(0.0, time.monotonic_ns(), np.zeros(0), np.zeros(6), np.zeros(3)),
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
