"""The client: a lease that outlives a busy service, a loss that is reported, and a process that ends."""

import subprocess
import sys
import threading

import pytest

from softarm_client import STALE_S, Arm
from softarm_client.commands import Refused
from softarm_client.errors import CommandRefusedError, SetupError
from tests.service.network.served import ServedArm

UNCLOSED = """
import sys
from softarm_client import Arm
client = Arm("test", sys.argv[1])
print(client.state().mode, client.state_age_s > 0.0)
watching = client.states().subscribe(lambda _: None)
watching.__enter__()
"""


@pytest.fixture
def arm(tmp_path):
    with ServedArm(tmp_path) as arm:
        yield arm


@pytest.fixture
def client(arm):
    with Arm("test", arm.endpoint) as client:
        yield client


def test_session_that_nobody_closed_does_not_keep_the_process(arm):
    command = [sys.executable, "-c", UNCLOSED, arm.endpoint]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert (done.returncode, done.stdout) == (0, "IDLE True\n"), done.stderr


def refusing(client, monkeypatch, code, times):
    """Have the next renewals refused."""
    left, command = [times], client.command

    def refuse(verb, *words, **fields):
        if verb == "lease/acquire" and left[0] > 0:
            left[0] -= 1
            raise CommandRefusedError(Refused(verb=verb, code=code, message="no", hint="wait"))
        return command(verb, *words, **fields)

    monkeypatch.setattr(client, "command", refuse)
    return left


def test_renewal_that_is_refused_as_busy_is_tried_again(client, monkeypatch):
    renewed = threading.Event()
    with client.lease(renew_s=0.05) as held:
        left = refusing(client, monkeypatch, "busy", 3)
        ends_s = held.ends_s
        while left[0] or held.ends_s == ends_s:
            assert not renewed.wait(0.01)
        assert not held.lost.is_set()
        assert client.arm().mode == "ARMED"


def test_lost_lease_is_reported_and_named_by_later_commands(client, monkeypatch):
    reasons = []
    with client.lease(renew_s=0.05, on_lost=reasons.append) as held:
        refusing(client, monkeypatch, "lease_held", 1)
        assert held.lost.wait(10.0)
        with pytest.raises(CommandRefusedError, match="the lease was lost"):
            client.arm()
    assert reasons == [held.reason]


def test_age_of_the_state_tells_that_the_service_is_gone(arm, client):
    while client.state_age_s > STALE_S:
        threading.Event().wait(0.01)
    arm.__exit__()
    while client.state_age_s < STALE_S:
        threading.Event().wait(0.01)


def test_name_that_is_not_plain_is_refused_at_once():
    with pytest.raises(SetupError, match="client name"):
        Arm("test", name="<b>")
