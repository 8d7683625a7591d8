"""Messages of an arm as messages of ROS 2: against the definitions of four distributions, through CDR."""

import math

import numpy as np
import pytest
from rosbags.typesys import Stores

from softarm_client.ros.interface import TOPICS
from softarm_client.ros.messages import FRESH_NS, ArmMessages
from tests.service.ros.made import BEGIN_NS, LATENCY_S, MILLISECOND_NS, SECTIONS, estimate, state
from tests.service.ros.typestore import DISTRIBUTIONS, Typestore

READINGS_NS = BEGIN_NS - round(LATENCY_S * 1e9)


@pytest.fixture(params=DISTRIBUTIONS, ids=lambda store: store.name)
def types(request):
    return Typestore(request.param)


def by_topic(outgoing, types):
    return {message.topic: types.through_cdr(message) for message in outgoing}


def xyz(vector):
    return vector.x, vector.y, vector.z


def unix_ns(header):
    return header.stamp.sec * 10**9 + header.stamp.nanosec


@pytest.fixture
def published(types):
    """Everything that an estimate and the state after it become, by topic, read back from CDR."""
    arm = ArmMessages("left-arm", types)
    return by_topic([*arm.of_estimate(estimate()), *arm.of_state(state())], types)


def test_a_pose_has_position_orientation_frame_and_the_time_of_its_readings(published):
    tip = published["sections/tip/pose"]
    assert (unix_ns(tip.header), tip.header.frame_id) == (READINGS_NS, "left_arm")
    assert xyz(tip.pose.position) == (0.01, -0.02, 0.27)
    assert (*xyz(tip.pose.orientation), tip.pose.orientation.w) == (0.0, 0.6, 0.0, 0.8)


def test_deviations_become_variances_and_a_pose_without_them_has_no_covariance(published):
    covariance = published["sections/tip/pose_with_covariance"].pose.covariance.reshape(6, 6)
    np.testing.assert_allclose(covariance, np.diag(np.square([1e-3, 2e-3, 3e-3, 0.01, 0.02, 0.03])))
    assert "sections/base/pose_with_covariance" not in published


def test_transforms_place_each_section_and_the_axes_of_its_force(published):
    frames = {frame.child_frame_id: frame for frame in published["/tf"].transforms}
    assert set(frames) == {f"left_arm/{name}" for name in ("base", "base/load", "tip", "tip/load")}
    assert {frame.header.frame_id for frame in frames.values()} == {"left_arm"}
    tip, load = frames["left_arm/tip"].transform, frames["left_arm/tip/load"].transform
    assert xyz(tip.translation) == xyz(load.translation) == (0.01, -0.02, 0.27)
    assert (tip.rotation.w, tip.rotation.y) == (0.8, 0.6)
    assert (*xyz(load.rotation), load.rotation.w) == (0.0, 0.0, 0.0, 1.0)


def test_a_force_is_in_base_axes_at_its_section_and_nan_where_it_is_not_estimated(published):
    wrench, std = published["sections/tip/wrench"], published["sections/tip/force_std"]
    for message in (wrench, std):
        assert (unix_ns(message.header), message.header.frame_id) == (READINGS_NS, "left_arm/tip/load")
    assert xyz(wrench.wrench.force)[:2] == (0.3, -0.1)
    assert xyz(std.vector)[:2] == pytest.approx((0.01, 0.02))
    unknown = (wrench.wrench.force.z, std.vector.z, *xyz(wrench.wrench.torque))
    assert all(map(math.isnan, unknown))
    assert published["in_contact"].data


def test_an_arrow_shows_the_force_for_as_long_as_it_is_fresh(published):
    (arrow,) = published["forces"].markers
    assert (arrow.header.frame_id, arrow.type, arrow.action) == ("left_arm/tip/load", 0, 0)
    begin, end = arrow.points
    assert xyz(begin) == (0.0, 0.0, 0.0)
    assert xyz(end) == pytest.approx((0.045, -0.015, 0.0))
    assert (arrow.pose.orientation.w, arrow.lifetime.sec, arrow.lifetime.nanosec) == (1.0, 0, FRESH_NS)


def test_pressures_are_those_of_the_state_and_a_lost_one_is_left_out(published):
    first = published["chambers/chamber_0/measured"]
    assert (first.fluid_pressure, first.variance) == (18.5e3, 0.0)
    assert (unix_ns(first.header), first.header.frame_id) == (BEGIN_NS + MILLISECOND_NS, "left_arm")
    assert "chambers/chamber_1/measured" not in published
    assert published["chambers/chamber_1/asked"].fluid_pressure == 10e3
    assert published["chambers/chamber_0/applied"].fluid_pressure == 19e3
    assert published["mode"].data == "HOLDING"


def test_the_interface_names_every_topic_and_its_type(types):
    arm = ArmMessages("sopra", types)
    messages = [*arm.of_estimate(estimate()), *arm.of_state(state())]
    found = {(message.topic, message.type) for message in messages}
    named = {
        (topic.at(section=section, chamber=chamber), topic.type)
        for name, topic in TOPICS.items()
        for section in ("base", "tip")
        for chamber in (0, 1)
        if name != "diagnostics"
    }
    assert found <= named
    assert {kind for _, kind in found} == {kind for _, kind in named}
    assert all(type(message.message) is types.store.types[message.type] for message in messages)


@pytest.fixture
def arm():
    return ArmMessages("sopra", Typestore(Stores.ROS2_JAZZY))


def poses(outgoing):
    return [message for message in outgoing if message.topic.endswith("/pose") or message.topic == "/tf"]


@pytest.mark.parametrize("status", ["not_converged", "no_data", "a newer word"])
def test_an_estimate_that_failed_publishes_neither_force_nor_pose(arm, status):
    assert list(arm.of_estimate(estimate(status=status))) == []
    assert poses(arm.of_state(state())) == []


def test_an_estimate_without_some_sensors_is_published(arm):
    assert list(arm.of_estimate(estimate(status="degraded")))
    assert poses(arm.of_state(state()))


def test_poses_that_a_state_repeats_are_not_published_again(arm):
    list(arm.of_estimate(estimate()))
    assert len(poses(arm.of_state(state(MILLISECOND_NS)))) == len(SECTIONS) + 1
    assert poses(arm.of_state(state(50 * MILLISECOND_NS))) == []


def test_poses_of_an_estimate_of_long_ago_are_left_out(arm):
    assert poses(arm.of_state(state())) == []
    list(arm.of_estimate(estimate()))
    assert poses(arm.of_state(state(FRESH_NS + 1))) == []


def test_a_force_of_long_ago_is_left_out(arm):
    list(arm.of_state(state(FRESH_NS + 1)))
    assert list(arm.of_estimate(estimate())) == []


def test_poses_carry_the_time_of_the_estimate_before_their_state(arm):
    for after_ns in (0, 10 * MILLISECOND_NS, 20 * MILLISECOND_NS):
        list(arm.of_estimate(estimate(after_ns)))
    (pose, *_) = poses(arm.of_state(state(15 * MILLISECOND_NS)))
    assert unix_ns(pose.message.header) == READINGS_NS + 10 * MILLISECOND_NS


def test_without_tf2_messages_everything_else_is_published(types):
    arm = ArmMessages("sopra", types, transforms=False)
    list(arm.of_estimate(estimate()))
    topics = [message.topic for message in arm.of_state(state())]
    assert "/tf" not in topics
    assert "sections/tip/pose" in topics
