"""The arm of a client: typed commands and streams over a real session, also with a newer service."""

import asyncio
import json
import subprocess
import sys
import threading

import pytest

from acceptance.reference.api_examples import EXAMPLES
from softarm_client import Arm, CommandRefusedError, Mode, ServiceSilentError
from softarm_client.arm import Experiment, Pressures, Recordings, Teach
from softarm_client.commands import VERBS, Applied
from softarm_client.messages import State
from softarm_client.results import Pose
from tests.service.standins import mismatch

UNTYPED = {"lease/acquire", "lease/release", "teach/list"}
COMMANDS = {
    "arm": Arm.arm,
    "disarm": Arm.disarm,
    "stop": Arm.stop,
    "clear": Arm.clear,
    "set_pressures": lambda service: Pressures(service).set([0.0]),
    "teach/start": lambda service: Teach(service).start(),
    "teach/hold": lambda service: Teach(service).hold(),
    "teach/save": lambda service: Teach(service).save("one"),
    "teach/goto": lambda service: Teach(service).goto("one"),
    "teach/release": lambda service: Teach(service).release(),
    "estimate/tare": Arm.tare,
    "experiment/begin": lambda service: Experiment(service).begin(),
    "experiment/end": lambda service: Experiment(service).end(),
    "calibrate/rest": Arm.align_at_rest,
    "record/start": lambda service: Recordings(service).start(),
    "record/stop": lambda service: Recordings(service).stop(),
    "device/reconnect": lambda service: Arm.reconnect(service, "gauge"),
}


class Answering:
    """A connection to a service that answers each command as the API page shows it."""

    def command(self, verb, timeout_s=1.0, **fields):
        self.verb = verb
        return Applied(verb=verb, mode=EXAMPLES[verb].mode, applied=dict(EXAMPLES[verb].applied))


@pytest.fixture
def arm(served):
    with Arm("test", served.endpoint) as arm:
        arm.states().wait_for(lambda state: state.mode == "IDLE", 20.0)
        yield arm


@pytest.mark.parametrize("verb", sorted(set(VERBS) - UNTYPED))
def test_each_command_answers_with_a_type_that_has_all_fields(verb):
    service = Answering()
    result = COMMANDS[verb](service)
    assert service.verb == verb
    assert set(EXAMPLES[verb].applied) == result.model_fields_set - {"mode"}


def test_commands_answer_with_what_was_applied(arm):
    with arm.lease():
        assert arm.arm().mode == "ARMED"
        answer = arm.pressures.set([20e3, 0.0, 0.0, 0.0, 0.0, 0.0], lifetime_s=0.5)
        assert (answer.asked_pa[0], answer.lifetime_s) == (20e3, 0.5)
        assert arm.disarm().asked_pa == (0.0,) * 6
        assert arm.stop().mode == "FAULTED"
    assert arm.teach.poses() == {}
    with pytest.raises(AttributeError):
        arm.teach.begin()


def test_saved_poses_are_read_whole_or_newer():
    pose = Pose.model_validate(
        {"pressures_pa": [1.0], "reachable": True, "note": "", "sections": [], "new": 1}
    )
    assert pose.pressures_pa == (1.0,)


def test_recording_of_a_block(arm, served):
    with arm.recording("pull") as recording:
        assert recording.path.endswith("pull.mcap")
        assert recording.dropped is None
    assert recording.dropped == 0


def test_loop_over_a_stream_ends_when_the_client_is_closed(served):
    arm = Arm("test", served.endpoint)
    modes = []
    for state in arm.states():
        modes.append(state.mode)
        if len(modes) == 3:
            arm.close()
    assert len(modes) >= 3
    assert set(modes) <= {"STARTING", "IDLE"}


def test_loop_over_the_stream_of_a_service_that_is_gone_names_the_stream_and_the_time(arm, served):
    states = iter(arm.states(silent_s=0.5))
    next(states)
    served.__exit__()
    with pytest.raises(ServiceSilentError, match=r"test/state: nothing published for 0\.5 s"):
        for _ in states:
            pass


async def test_asynchronous_loop(served):
    arm = await asyncio.to_thread(Arm, "test", served.endpoint)
    seen = []
    async for state in arm.states():
        seen.append(state.ticks)
        if len(seen) == 3:
            await asyncio.to_thread(arm.close)
    assert seen == sorted(seen)


async def test_asynchronous_loop_over_the_stream_of_a_service_that_is_gone(arm, served):
    async def follow():
        async for _ in arm.states(silent_s=0.5):
            if not gone.is_set():
                gone.set()
                await asyncio.to_thread(served.__exit__)

    gone = asyncio.Event()
    with pytest.raises(ServiceSilentError, match="nothing published"):
        await asyncio.wait_for(follow(), 20.0)


def test_messages_of_a_newer_service_are_read(arm, served):
    newer = json.loads(mismatch(1).model_dump_json())
    newer["stamp"]["source"], newer["stamp"]["host"], newer["seen_by"] = "twin", "lab", ["tip"]
    arrived, found = threading.Event(), []

    def take(message):
        if message.stamp.source == "twin":  # the service publishes its own as well
            found.append(message)
            arrived.set()

    with arm.mismatches().subscribe(take):
        while not arrived.wait(0.05):
            served.in_loop(lambda: served.bus.session.put(arm.keys.stream("mismatch"), json.dumps(newer)))
            served.in_loop(lambda: served.bus.session.put(arm.keys.stream("forecast"), b"{}"))
    assert found[0].consistent


def test_mode_of_a_newer_service_is_read_as_it_stands(arm):
    newer = json.loads(arm.state().model_dump_json())
    newer["mode"] = "PARKED"
    assert State.model_validate(newer).mode == "PARKED"
    assert State.model_validate({**newer, "mode": "IDLE"}).mode is Mode.IDLE


def test_misspelt_field_of_a_request_is_refused(arm):
    with pytest.raises(CommandRefusedError, match="lifetime"):
        arm.command("clear", lifetime=1.0)


def test_import_is_light():
    code = (
        "import sys, softarm_client; print(sorted({'numpy', 'numba', 'scipy', 'softarm'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
