"""One rig for all: fakes with the dynamic arm, and the service with its finite elements, as processes."""

import socket
from pathlib import Path

import pytest

from service.experiments.bench import FakeControl
from service.experiments.session import connect, wait_ready
from service.rig import FakeRig, RigSettings

EXAMPLES = Path(__file__).parents[3] / "examples"


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(scope="package")
def rig(tmp_path_factory):
    settings = RigSettings(
        EXAMPLES / "scenarios" / "demo.toml",
        specimen=str(EXAMPLES / "specimens" / "fake_arm.toml"),
        endpoint=f"tcp/127.0.0.1:{free_port()}",
        sensors=("orientation", "bend"),
    )
    with FakeRig(settings, tmp_path_factory.mktemp("rig")) as running:
        yield running


@pytest.fixture(scope="package")
def client(rig):
    with connect(rig) as client:
        wait_ready(client)
        yield client


@pytest.fixture(scope="package")
def fakes(rig):
    with FakeControl(str(rig.announcement["control"])) as control:
        yield control
