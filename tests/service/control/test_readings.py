"""When a packet of the leading device is complete."""

from softarm.daemon.config import SafetySettings, SensorSettings
from softarm.daemon.control.channels import ChannelReading, channel_reading
from softarm.daemon.control.readings import Readings, leading_channels

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
