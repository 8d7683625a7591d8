"""Waiting for a service that builds its estimator: as long as it builds, and no longer than it lives."""

import logging
import threading

import pytest

from softarm.daemon.estimation.worker import WorkerState
from softarm.estimator.errors import InputError
from softarm.experiments.session import wait_built
from softarm_client import Arm
from softarm_client.modes import Mode
from tests.service import standins
from tests.service.network.served import ServedArm

BUILDING = WorkerState(running=False, restarts=0, gave_up=False)


class BuildingEstimator(standins.Estimator):
    """An estimator that is being built until the test says otherwise."""

    built = threading.Event()

    @property
    def state(self):
        return WorkerState(running=True, restarts=0, gave_up=False) if self.built.is_set() else BUILDING

    @state.setter
    def state(self, _):
        pass


@pytest.fixture
def built(monkeypatch):
    built = threading.Event()
    monkeypatch.setattr(BuildingEstimator, "built", built)
    monkeypatch.setattr(standins, "Estimator", BuildingEstimator)
    return built


def test_an_estimator_is_waited_for_while_it_is_built_and_progress_is_reported(tmp_path, built, caplog):
    caplog.set_level(logging.WARNING, "softarm.experiments.session")
    with ServedArm(tmp_path, up={Mode.STARTING}) as arm, Arm("test", arm.endpoint) as client:
        waiting = threading.Thread(target=wait_built, args=(client, 10.0, 0.05))
        waiting.start()
        while not any("is being built" in line for line in caplog.messages):
            assert waiting.is_alive()
            waiting.join(0.01)
        built.set()
        waiting.join(20.0)
        assert not waiting.is_alive()


def test_a_service_that_falls_silent_while_it_builds_is_not_waited_for(tmp_path, built):
    arm = ServedArm(tmp_path, up={Mode.STARTING}).__enter__()
    with Arm("test", arm.endpoint) as client:
        assert client.state(20.0).mode == "STARTING"
        arm.__exit__()
        with pytest.raises(InputError, match="published no state"):
            wait_built(client, silent_s=0.3)
