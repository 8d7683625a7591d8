"""A bag of a served arm, written and read by an independent implementation of ROS 2's formats."""

import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores

from softarm_client import Arm
from softarm_client.ros.diagnostics import Diagnostics
from softarm_client.ros.messages import ArmMessages
from tests.service.network.served import ServedArm
from tests.service.ros.typestore import Typestore

STATES = 3


@pytest.fixture
def heard(tmp_path):
    """Some estimates and states of an arm, in the order in which they were made."""
    with ServedArm(tmp_path) as served, Arm("test", served.endpoint) as arm:
        heard = []
        with arm.estimates().subscribe(heard.append):
            for count, state in enumerate(arm.states(), 1):
                heard.append(state)
                if count > STATES and len(heard) > 2 * STATES:
                    break
    return sorted(heard, key=lambda message: message.stamp.unix_ns)


@pytest.mark.parametrize("plugin", list(StoragePlugin), ids=lambda plugin: plugin.name)
def test_a_bag_of_an_arm_holds_every_field(heard, plugin, tmp_path):
    types = Typestore(Stores.ROS2_JAZZY)
    arm, diagnostics, written = ArmMessages("test", types), Diagnostics("test", types), []
    with Writer(tmp_path / "bag", version=9, storage_plugin=plugin) as bag:
        connections = {}
        for message in heard:
            if message.type == "softarm.state/1":
                diagnostics.note_state(message)
                translated = [*arm.of_state(message), diagnostics.report()]
            else:
                translated = list(arm.of_estimate(message))
            for outgoing in translated:
                if outgoing.topic not in connections:
                    connections[outgoing.topic] = bag.add_connection(
                        outgoing.topic, outgoing.type, typestore=types.store
                    )
                raw = types.store.serialize_cdr(outgoing.message, outgoing.type)
                bag.write(connections[outgoing.topic], message.stamp.unix_ns, raw)
                written.append((outgoing.topic, outgoing.type, repr(outgoing.message)))
    with Reader(tmp_path / "bag") as bag:
        read = [
            (connection.topic, connection.msgtype, repr(types.store.deserialize_cdr(raw, connection.msgtype)))
            for connection, _, raw in bag.messages()
        ]
    assert sorted(read) == sorted(written)
    states = [message for message in heard if message.type == "softarm.state/1"]
    assert [text for topic, _, text in read if topic == "mode"] == [
        repr(types("std_msgs/msg/String")(data=str(state.mode))) for state in states
    ]
    topics = {topic for topic, *_ in read}
    assert {"/tf", "/diagnostics", "sections/tip/pose", "sections/tip/wrench"} <= topics
    assert {f"chambers/chamber_{chamber}/measured" for chamber in range(6)} <= topics
