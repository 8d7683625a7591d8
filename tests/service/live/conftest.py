"""One rig for all: fakes with the dynamic arm, and the service with its finite elements, as processes."""

import pytest

from softarm.common.shipped import DEMO_SCENARIO, fake_specimen
from softarm.experiments.rig import FakeRig, RigSettings, free_endpoint
from softarm.experiments.rig_control import FakeControl
from softarm.experiments.session import connect, wait_ready
from tests.service.live.helpers import cleared


@pytest.fixture(scope="package")
def rig(tmp_path_factory):
    settings = RigSettings(
        DEMO_SCENARIO,
        specimen=str(fake_specimen()),
        endpoint=free_endpoint(),
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


@pytest.fixture
def provokes_a_fault():
    """A test that asks for this ends a pressurised mode once, and on purpose."""


@pytest.fixture(scope="package")
def faults(client):
    """Every change of mode to FAULTED, in the words of the service."""
    found = []

    def on_event(event):
        if event.kind == "mode" and "-> FAULTED" in event.text:
            found.append(event.text)

    with client.events().subscribe(on_event):
        yield found


@pytest.fixture(autouse=True)
def _idle(request):
    """Begin with a cleared arm and no fault at the fakes; a fault that the test did not provoke fails it."""
    if "client" not in request.fixturenames:
        yield
        return
    client, fakes = request.getfixturevalue("client"), request.getfixturevalue("fakes")
    faults = request.getfixturevalue("faults")
    for ask in ("clear", "hand", "cord"):
        fakes.ask(ask)
    if wait_ready(client).mode != "IDLE":
        client.stop()
        cleared(client)
    faults.clear()
    yield
    assert len(faults) == ("provokes_a_fault" in request.fixturenames), faults
