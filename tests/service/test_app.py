"""The service as a whole in this process: what it does first when it ends."""

import asyncio
import multiprocessing
import threading
from dataclasses import replace

import pytest

from softarm.daemon import app
from softarm.daemon.app import Service
from softarm.daemon.estimation import worker
from softarm.daemon.loop import ControlLoop
from softarm.daemon.notify import Notifier
from softarm_client.session import NetworkSettings
from tests.service.standins import Instruments, Valves, setup_in


class Endless:
    """An estimator whose process is being built for ever, and does not see that its pipe closes."""

    def __init__(self, *_):
        pass

    def __call__(self):
        threading.Event().wait()


class WatchedInstruments(Instruments):
    """Notes what happens to the valves, and how many processes live then."""

    def __init__(self, _, readings):
        super().__init__(readings)
        self.log = []
        self.valves = valves = Valves()
        valves.vent = lambda reason: self.log.append(("vent", len(multiprocessing.active_children())))

    async def connect(self):
        pass

    async def close(self):
        self.log.append(("close", len(multiprocessing.active_children())))


@pytest.fixture
def make_service(tmp_path, monkeypatch):
    monkeypatch.setattr(app, "SolverSettings", Endless)
    monkeypatch.setattr(app, "LiveInstruments", WatchedInstruments)
    monkeypatch.setattr(worker, "KILL_AFTER_S", 0.2)
    setup = setup_in(tmp_path)
    network = NetworkSettings(listen=("tcp/127.0.0.1:0",))
    setup = replace(setup, config=setup.config.model_copy(update={"network": network}))
    notifier = Notifier(None)
    yield lambda: Service(setup, notifier)
    notifier.close()


@pytest.mark.parametrize("fails", [False, True])
async def test_the_arm_is_vented_and_closed_before_an_estimator_that_does_not_end_is_waited_for(
    make_service, monkeypatch, fails
):
    service = make_service()

    def step(self, tick):
        if fails:
            raise ZeroDivisionError
        service.stop()

    monkeypatch.setattr(ControlLoop, "step", step)
    running = asyncio.create_task(service.run())
    await asyncio.wait([running])
    assert (running.exception() is not None) is fails
    assert service._loop.instruments.log == [("vent", 1), ("close", 1)]
    assert not multiprocessing.active_children()
