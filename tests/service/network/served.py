"""An arm behind a real bus without devices or estimator: what a client sends moves the real controller."""

import asyncio
import json
import threading
import time
from dataclasses import replace

from softarm.daemon.config import SafetySettings
from softarm.daemon.control.command_server import CommandServer
from softarm.daemon.control.dependencies import LoopDependencies
from softarm.daemon.control.tick import Ticker
from softarm.daemon.loop import ControlLoop
from softarm.daemon.network.bus import Bus
from softarm.daemon.network.inbox import serve_each
from softarm_client.modes import Mode
from softarm_client.session import NetworkSettings, client_settings, open_session
from tests.service import standins
from tests.service.standins import listening_endpoint

TICK_S = 0.02
FREE_PORT = NetworkSettings(listen=("tcp/127.0.0.1:0",))


class Valves(standins.Valves):
    """Remembers its set-point and takes any while it is armed."""

    pressures = (0.0,) * 6

    def vent(self, reason):
        super().vent(reason)
        self.pressures = (0.0,) * 6

    def command(self, setpoint, lifetime_s):
        super().command(setpoint, lifetime_s)
        self.pressures = tuple(setpoint)


class ServedArm:
    """Serves the arm ``test`` from a thread of its own, for the length of a block.

    Args:
        folder: Takes poses and recordings.
        settings: Where to listen.
        endpoint: Where clients connect; the service's own port when left out.
        up: Modes in which the arm counts as up: the block begins in one of them.
    """

    def __init__(self, folder, settings=FREE_PORT, endpoint=None, up=frozenset(Mode) - {Mode.STARTING}):
        self._folder, self._settings, self.endpoint = folder, settings, endpoint
        self._up_modes = up
        self._up = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)

    def __enter__(self):
        self._thread.start()
        assert self._up.wait(20.0)
        return self

    def __exit__(self, *_):
        if self._thread.is_alive():
            self.loop.call_soon_threadsafe(self._end.set)
            self._thread.join()

    async def _serve(self):
        self.loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        setup = standins.setup_in(self._folder)
        safety = SafetySettings(lease_s=60.0)
        setup = replace(setup, config=setup.config.model_copy(update={"safety": safety}))
        with Bus(self._settings, "test", self.loop) as self.bus:
            dependencies = LoopDependencies(self._instruments, standins.Estimator, self.bus, "", lambda: None)
            control = ControlLoop(setup, dependencies)
            self.controller = control.controller
            self.server = CommandServer(self.bus, control)
            self.bus.open({"config": b"{}"}, self.server.stop)
            own = self.endpoint or await asyncio.to_thread(listening_endpoint, self.bus.session)
            self.endpoint = own
            async with asyncio.TaskGroup() as tasks:
                background = (
                    tasks.create_task(serve_each(self.bus.next_call, self.server.serve, tasks)),
                    tasks.create_task(self._step(control)),
                )
                await self._end.wait()
                for task in background:
                    task.cancel()

    async def _step(self, control):
        with Ticker(TICK_S) as ticker:
            async for tick in ticker.ticks():
                control.instruments.read()
                control.step(tick)
                if self.mode in self._up_modes:
                    self._up.set()

    def _instruments(self, readings):
        instruments = standins.Instruments(readings)
        self.valves = instruments.valves = Valves()
        return instruments

    def in_loop(self, function):
        """Call a function in the service's loop and return its result."""

        async def call():
            return function()

        return asyncio.run_coroutine_threadsafe(call(), self.loop).result(20.0)

    def publish(self, event, mismatch):
        """Publish on each stream as the service does."""

        def publish():
            self.bus.publish("event", event)
            self.bus.publish("mismatch", mismatch)
            self.bus.publish_shape(b"\0" * 16)
            return True

        return self.in_loop(publish)

    @property
    def mode(self):
        return self.controller.modes.mode


class Sender:
    """Sends raw payloads to an arm's commands."""

    def __init__(self, endpoint, arm="test", config=None):
        self._session = open_session(client_settings(endpoint, config))
        self._base = f"softarm/@v1/{arm}/command/"
        self._sequence = 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._session.close()

    def raw(self, verb, payload, key=None):
        """Send bytes and return the one answer; ``payload`` ``None`` sends no payload at all."""
        asked = self._session.get(key or self._base + verb, payload=payload, timeout=10.0)
        (reply,) = list(asked)
        return json.loads(bytes((reply.err if reply.ok is None else reply.ok).payload))

    def send(self, verb, **fields):
        """Send a request with all that it needs."""
        self._sequence += 1
        common = {"deadline_unix_ns": time.time_ns() + 10**10, "sequence": self._sequence, "client": "test"}
        return self.raw(verb, json.dumps(common | fields).encode())
