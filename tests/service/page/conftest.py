"""The control loop on stand-ins of devices and estimator, for a real page."""

import asyncio
import contextlib
import threading
import time

import pytest

from softarm.daemon.control.command_server import CommandServer
from softarm.daemon.control.dependencies import LoopDependencies
from softarm.daemon.control.tick import Ticker
from softarm.daemon.loop import ControlLoop
from softarm.daemon.network.bus import Bus
from softarm.daemon.surface import drawn_surface
from softarm.estimator.geometry import build_mesh
from softarm_client.session import NetworkSettings
from tests.service.standins import SPECIMEN, Estimator, Instruments, listening_endpoint, setup_in

TICK_S = 0.02


class PageService:
    """Serves the arm ``page`` from a thread of its own."""

    def __init__(self, folder):
        self.endpoint = ""
        self.verbs_seen = []
        self._folder = folder
        self._ready = threading.Event()
        self._silent = False
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)

    def __enter__(self):
        self._thread.start()
        assert self._ready.wait(20.0)
        return self

    def __exit__(self, *_):
        self.end()

    def end(self):
        """End the service, unless it has ended."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join()

    @contextlib.contextmanager
    def silent(self):
        """Publish nothing within the block; commands are answered all the same."""
        self._silent = True
        yield
        self._silent = False

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
        with Bus(NetworkSettings(listen=("tcp/127.0.0.1:0",)), "page", self._loop) as bus:
            dependencies = LoopDependencies(Instruments, Estimator, bus, "", lambda: None)
            self.control = ControlLoop(setup_in(self._folder), dependencies)
            specimen = SPECIMEN.model_dump_json(by_alias=True).encode()
            server = CommandServer(bus, self.control)
            bus.open({"specimen": specimen, "surface": None}, server.stop)
            mesh = build_mesh(SPECIMEN)
            bus.provide("surface", drawn_surface(mesh).message(mesh).model_dump_json().encode())
            self.endpoint = await asyncio.to_thread(listening_endpoint, bus.session)
            stepping = asyncio.create_task(self._step())
            answering = asyncio.create_task(self._answer(bus, server))
            self._ready.set()
            await self._stop.wait()
            for task in (stepping, answering):
                task.cancel()
            await asyncio.wait((stepping, answering))

    async def _answer(self, bus, server):
        while True:
            call = await bus.next_call()
            await server.serve(call)
            self.verbs_seen.append(call.verb)

    async def _step(self):
        with Ticker(TICK_S) as ticker:
            async for tick in ticker.ticks():
                if not self._silent:
                    self.control.instruments.read()
                    self.control.step(tick)
                self._stepped.set()


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    with PageService(tmp_path_factory.mktemp("service")) as running:
        yield running
