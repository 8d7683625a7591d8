"""The node in a real ROS 2, as a process beside the node of a user."""

import contextlib
import json
import math
import os
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest
from rosbags.typesys import Stores

from softarm.experiments.rig import free_endpoint
from softarm_client import Arm
from softarm_client.ros.interface import SERVICES, SUBSCRIBED, TOPICS, TRANSFORMS
from tests.service.network.served import ServedArm
from tests.service.ros.typestore import Typestore

ROOT = Path(__file__).parents[3]
PYTHON = ROOT / ".venv-ros" / "bin" / "python"
SECTIONS = "base", "intermediate", "tip"
LOADED = "intermediate", "tip"

pytestmark = [
    pytest.mark.timeout(120),
    pytest.mark.skipif(not PYTHON.exists(), reason="no ROS 2 in .venv-ros: ./run test installs it"),
]


def in_ros(*words, **more):
    """Start Python in the environment of ROS 2, in a domain of this test run."""
    environment = {
        "PATH": "/usr/bin:/bin",
        "HOME": os.environ.get("HOME", "/"),
        "PYTHONPATH": str(ROOT / "service"),
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
    }
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([PYTHON, *words], env=environment | more, text=True, **pipes)


@contextlib.contextmanager
def ended(process):
    """End a process with the block, by a signal and the end of its input: it leaves no shared memory."""
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    with ServedArm(tmp_path_factory.mktemp("served")) as served:
        yield served


@pytest.fixture(scope="module")
def node(served):
    """The node of the arm ``test``, up."""
    command = in_ros("-m", "softarm_client.ros", "--arm", "test", "--endpoint", served.endpoint)
    with ended(command) as node:
        for line in node.stderr:
            if line == "ROS 2 node /test/softarm; ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST\n":
                yield node
                return
        pytest.fail("the node ended")


@pytest.fixture(scope="module")
def probe(node):
    """Ask the user's node to do something; returns its answer."""
    with ended(
        in_ros(Path(__file__).with_name("probe.py"), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    ) as user:

        def ask(*words):
            print(*words, file=user.stdin, flush=True)
            line = user.stdout.readline()
            assert line, user.stderr.read()
            return json.loads(line)

        yield ask


@pytest.fixture
def take(probe):
    """Take the next message of a topic, decoded by an implementation other than that of ROS 2."""
    types = Typestore(Stores.ROS2_KILTED)

    def take(topic, kind):
        return types.store.deserialize_cdr(bytes.fromhex(probe("take", kind, topic)), kind)

    return take


def names(pattern):
    """Every name that a pattern of the interface stands for, of the arm ``test``."""
    absolute = pattern if pattern.startswith("/") else f"/test/{pattern}"
    places = LOADED if "wrench" in pattern or "force_std" in pattern else SECTIONS
    for section in places:
        for chamber in range(6):
            yield absolute.replace("<section>", section).replace("<chamber>", str(chamber))


def test_users_find_the_whole_interface(probe, take):
    # What stands on an estimate is announced with the first of them.
    take("/test/sections/tip/pose", "geometry_msgs/msg/PoseStamped")
    take("/test/forces", "visualization_msgs/msg/MarkerArray")
    take("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    expected = {
        name: [topic.type]
        for topic in TOPICS.values()
        if topic.type != TRANSFORMS  # the wheels have no tf2_msgs
        for name in names(topic.name)
    }
    expected |= {f"/test/{name}": [kind] for name, (kind, _) in SUBSCRIBED.items()}
    # Each participant hears of another's topics one after the other.
    deadline = time.monotonic() + 20.0
    while expected.keys() - (found := probe("names"))["topics"].keys() and time.monotonic() < deadline:
        continue
    assert {name: found["topics"].get(name) for name in expected} == expected
    services = {f"/test/{name}": ["std_srvs/srv/Trigger"] for name in SERVICES if "<" not in name}
    assert {name: found["services"].get(name) for name in services} == services
    assert not {name for name in found["topics"] if name.startswith("/test/")} - set(expected)


def test_messages_of_ros_hold_what_the_arm_says(take, served):
    with Arm("test", served.endpoint) as arm:
        state, estimate = arm.states().wait_for(lambda state: state.sections, 20.0), arm.estimate()
    pose = take("/test/sections/tip/pose", "geometry_msgs/msg/PoseStamped")
    (tip,) = (section for section in state.sections if section.section == "tip")
    assert (pose.pose.position.x, pose.pose.position.y, pose.pose.position.z) == tip.position_m
    assert (pose.header.frame_id, pose.pose.orientation.w) == ("test", tip.quaternion_wxyz[0])
    (load,) = (load for load in estimate.loads if load.section == "tip")
    wrench = take("/test/sections/tip/wrench", "geometry_msgs/msg/WrenchStamped")
    assert wrench.header.frame_id == "test/tip/load"
    assert (wrench.wrench.force.x, wrench.wrench.force.y) == pytest.approx(load.force_n[:2])
    assert math.isnan(wrench.wrench.force.z)
    assert wrench.header.stamp.sec >= estimate.stamp.unix_ns // 10**9 - 1
    assert take("/test/mode", "std_msgs/msg/String").data == state.mode
    covariance = take(
        "/test/sections/tip/pose_with_covariance", "geometry_msgs/msg/PoseWithCovarianceStamped"
    )
    assert covariance.pose.covariance.shape == (36,)
    assert len(take("/test/forces", "visualization_msgs/msg/MarkerArray").markers) == len(LOADED)
    diagnostics = take("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    parts = {status.name: status.message for status in diagnostics.status}
    assert parts["test: service"] == state.mode
    assert parts["test: estimate"] == "converged"


def test_callers_lease_arm_ask_for_pressures_teach_and_stop(probe, served):
    done, why = probe("call", "/test/arm")
    assert not done
    assert "lease" in why
    for verb in ("lease/acquire", "arm", "experiment/begin"):
        assert probe("call", f"/test/{verb}")[0]
    assert probe("publish", "/test/set_pressures", 1e4, 0, 0, 0, 0, 0)
    with Arm("test", served.endpoint) as arm:
        arm.states().wait_for(lambda state: state.asked_pa[0] == 1e4, 20.0)
        assert probe("publish", "/test/set_pressures", "nan", 0, 0, 0, 0, 0)
        assert probe("log", "set_pressures: ")
        assert probe("call", "/test/experiment/end")[0]
        assert probe("call", "/test/teach/start")[0]
        assert probe("set", "/test/softarm/set_parameters", "pose_name", "left")
        assert probe("call", "/test/teach/save")[0]
        assert probe("call", "/test/teach/hold")[0]
        done, result = probe("call", "/test/teach/goto/left")
        assert done, result
        assert json.loads(result)["name"] == "left"
    assert probe("call", "/test/stop")[0]
    assert served.mode == "FAULTED"
    assert probe("call", "/test/clear")[0]


def test_a_node_that_ends_gives_the_lease_back(probe, served, node):
    assert probe("call", "/test/lease/acquire")[0]
    node.send_signal(signal.SIGTERM)
    assert node.wait(20) == 0
    with Arm("test", served.endpoint, "operator") as other, other.lease():
        pass


BROKEN = """
import signal, rclpy
from rclpy.signals import SignalHandlerOptions
from softarm_client.ros.node import _spinning
def broken():
    raise RuntimeError("broken")
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node("broken")
node.create_timer(0.01, broken)
with _spinning(node):
    print(signal.sigwait([signal.SIGTERM]).name)
"""


def test_a_node_whose_callbacks_fail_ends():
    with ended(in_ros("-c", BROKEN, ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")) as node:
        told, errors = node.communicate(timeout=60)
    assert told == "SIGTERM\n"
    assert errors.splitlines()[-1] == "RuntimeError: broken"
    assert node.returncode == 1


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--ros-args", "-r", "wrong"), "ROS 2: does not start ("),
        (("--ros-args", "-p", "ramp_s:=soon"), "ROS 2: "),
        (("--wrong",), "arguments: '--wrong' is unknown"),
    ],
)
def test_wrong_arguments_are_one_line(served, arguments, told):
    command = ("-m", "softarm_client.ros", "--arm", "test", "--endpoint", served.endpoint, *arguments)
    with ended(in_ros(*command)) as node:
        _, errors = node.communicate(timeout=60)
        assert node.returncode == 2
    assert errors.splitlines()[-1].startswith(f"softarm: {told}")
    assert "Traceback" not in errors


def test_a_node_waits_for_its_service_and_ends_on_a_signal():
    endpoint = free_endpoint()
    with ended(in_ros("-m", "softarm_client.ros", "--arm", "test", "--endpoint", endpoint)) as node:
        assert re.match(f"waiting for the service: .*{endpoint}.*nothing answers", node.stderr.readline())
        node.send_signal(signal.SIGINT)
        assert node.wait(20) == 0
