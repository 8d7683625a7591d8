"""When a packet of the leading device is complete."""

import numpy as np
import pytest

from softarm.daemon.config import SafetySettings, SensorSettings
from softarm.daemon.control.channels import ChannelReading
from softarm.daemon.control.readings import Readings, leading_channels
from tests.service.standins import channel_reading

SENSORS = (
    SensorSettings(kind="bend", section="tip", device="bend", channel="1"),
    SensorSettings(
        kind="orientation", section="intermediate", device="qtm", channel="intermediate", needed=True
    ),
    SensorSettings(kind="orientation", section="tip", device="qtm", channel="tip", needed=True),
)


def pose(name: str, arrival_ns: int) -> ChannelReading:
    return channel_reading(name, (0.0,) * 7, arrival_ns, "fake")


def test_the_needed_device_leads() -> None:
    assert leading_channels(SENSORS) == ("qtm/intermediate", "qtm/tip")
    assert leading_channels(SENSORS[:1]) == ("bend/1",)
    assert leading_channels(()) == ()


def test_a_packet_is_complete_with_its_last_body() -> None:
    done: list[str] = []
    readings = Readings(
        SENSORS,
        "",
        SafetySettings(),
        lambda reading: done.append(reading.device),
        lambda: done.append("packet"),
    )
    for name, arrival in (
        ("qtm/intermediate", 1),
        ("qtm/base", 1),
        ("qtm/tip", 1),
        ("bend/1", 2),
        ("qtm/tip", 3),
        ("qtm/intermediate", 3),
    ):
        readings.put(pose(name, arrival))
    assert done == [
        "qtm/intermediate",
        "qtm/base",
        "packet",
        "qtm/tip",
        "bend/1",
        "qtm/tip",
        "packet",
        "qtm/intermediate",
    ]


def test_trouble_of_one_body_is_not_told_of_another() -> None:
    readings = Readings(SENSORS, "", SafetySettings(), lambda *_: None)
    told = readings.inputs(0, {"qtm/tip": "lost", "bend": "unplugged"})
    assert [entry.trouble for entry in told] == ["unplugged", "", "lost"]


TURNED = (0.7071067811865476, 0.7071067811865476, 0.0, 0.0)
"""A quarter of a turn about x."""


def gathered(sensors: tuple[SensorSettings, ...], base: str = "") -> Readings:
    return Readings(sensors, base, SafetySettings(), lambda *_: None)


def test_an_inertial_unit_shows_nothing_until_it_is_aligned_with_the_arm_at_rest() -> None:
    """Its zero is where it was switched on; at rest it shows what the model says of its section."""
    unit = SensorSettings(kind="orientation", section="tip", device="imu")
    readings = gathered((unit, SENSORS[0]))
    readings.put(channel_reading("imu", TURNED, 5, "fake"))
    assert readings.snapshot(5).lost == ("orientation_tip", "bend_tip")
    assert readings.rest({"tip": np.eye(3)}, 5 + 10**9) == ()  # silent: who knows where it is now
    assert readings.rest({"tip": np.eye(3)}, 5) == ("imu",)
    shot = readings.snapshot(5)
    assert (shot.used, shot.lost) == (("orientation_tip",), ("bend_tip",))
    assert shot.readings[:4] == pytest.approx([1.0, 0.0, 0.0, 0.0])


def test_poses_are_seen_from_the_base_and_lost_while_it_was_never_seen() -> None:
    readings = gathered(SENSORS[1:], "qtm/base")
    section = (1.0, 2.0, 3.0, *TURNED)
    for name in ("qtm/intermediate", "qtm/tip"):
        readings.put(channel_reading(name, section, 5, "fake"))
    assert readings.snapshot(5).used == ()
    readings.put(channel_reading("qtm/base", (1.0, 2.0, 2.0, *TURNED), 1, "fake"))
    late = 5 + 10**6
    assert readings.snapshot(late).readings == pytest.approx([1.0, 0.0, 0.0, 0.0] * 2)
    pose_seen = gathered((SENSORS[2].model_copy(update={"kind": "pose"}),), "qtm/base")
    pose_seen.put(channel_reading("qtm/base", (1.0, 2.0, 2.0, *TURNED), 1, "fake"))
    pose_seen.put(channel_reading("qtm/tip", section, 5, "fake"))
    # One metre up in the laboratory is one along y of a base that is turned about x.
    assert pose_seen.snapshot(5).readings == pytest.approx([0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0])
