"""What the services do, on a real controller over a real session."""

import json
import queue

import pytest

from softarm_client import Arm
from softarm_client.commands import VERBS
from softarm_client.ros.interface import PARAMETERS, SERVICES
from softarm_client.ros.services import LeaseKeeper, answer, verbs


@pytest.fixture
def arm(served):
    with Arm("test", served.endpoint, "ROS node") as arm:
        arm.states().wait_for(lambda state: state.mode == "IDLE", 20.0)
        yield arm


@pytest.fixture
def lost():
    return queue.Queue()


@pytest.fixture
def call(arm, lost):
    """Call a service by name; returns whether it was accepted, and its message."""
    values = {name: default for name, (default, _) in PARAMETERS.items()}
    lease = LeaseKeeper(arm, lost.put)
    commands = verbs(arm, lease, values.__getitem__)
    yield lambda name: answer(commands[name])
    lease.release()


def test_there_is_a_service_for_every_verb_that_needs_no_argument():
    elsewhere = {"set_pressures", "teach/list", "teach/goto", "device/reconnect"}
    assert set(SERVICES) == {"teach/goto/<pose>"} | (set(VERBS) - elsewhere)


def test_the_lease_is_held_until_it_is_released(call, served):
    done, why = call("arm")
    assert not done
    assert "lease" in why
    for _ in range(2):
        assert call("lease/acquire") == (True, "the node holds the lease")
    done, result = call("arm")
    assert (done, json.loads(result)["mode"]) == (True, "ARMED")
    assert call("lease/release")[0]
    assert not call("teach/start")[0]


def test_teaching_and_recording_take_their_names_from_parameters(call, served):
    for name in ("lease/acquire", "arm", "teach/start", "teach/save", "teach/hold", "teach/release"):
        assert call(name)[0], call(name)
    with Arm("test", served.endpoint) as arm:
        assert set(arm.teach.poses()) == {PARAMETERS["pose_name"][0]}
    assert json.loads(call("record/start")[1])["path"].endswith("recording.mcap")
    assert json.loads(call("record/stop")[1])["dropped"] == 0


def test_stop_needs_no_lease_and_clear_leaves_the_fault(call, served):
    assert call("stop")[0]
    assert served.mode == "FAULTED"
    assert call("clear")[0]
    assert served.mode == "IDLE"


def test_a_lease_of_somebody_else_is_not_taken(call, served):
    with Arm("test", served.endpoint, "operator") as other, other.lease():
        done, why = call("lease/acquire")
        assert not done
        assert "operator" in why
    assert call("lease/acquire")[0]


def test_a_lost_lease_is_told_and_can_be_acquired_again(arm, call, served, lost):
    assert call("lease/acquire")[0]
    with Arm("test", served.endpoint, "operator") as other:
        other.command("lease/release", lease=arm._lease)
        with other.lease():
            assert lost.get(timeout=20.0).startswith("the lease was lost: ")
            assert not call("lease/acquire")[0]
    assert call("lease/acquire")[0]
    assert call("arm")[0]
