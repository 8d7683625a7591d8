"""The QTM client against a scripted peer, in virtual time: greeting, versions, names, frames."""

import asyncio
import struct
from typing import Any

import pytest

from softarm.drivers.errors import ConfigurationError, ConnectionLost, ProtocolError
from softarm.drivers.qualisys.device import QualisysConfig
from softarm.drivers.supervisor import ConnectionState
from tests.drivers.qualisys.qtm_peer import Peer, Rig, event, frame, refused, run, settings, text


def test_a_session_from_greeting_to_frames(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        assert rig.peer.commands == [
            "Version 1.25",
            "QTMVersion",
            "GetState",
            "GetParameters General 6D",
            "StreamFrames AllFrames 6D",
        ]
        await rig.say(frame(1, 100.0, 200.0), frame(2, 101.0, None))
        first, second = rig.readings
        assert first.valid
        assert first.value.poses["tip"].position == pytest.approx((0.2, 0, 0))  # type: ignore[union-attr]
        assert second.valid
        assert second.value.poses["tip"] is None
        assert second.flags == ("lost:tip",)
        assert (first.sequence, first.device_time_ns) == (1, 10_000_000)
        assert rig.device.health.facts["version"] == "QTM Version is 2.3 (build 464)"
        assert rig.device.health.facts["bodies"] == "base, tip"
        assert rig.device.source == "qtm+tcp://10.0.0.1:22223"
        await rig.device.close()
        assert rig.peer.commands[-1] == "StreamFrames Stop"

    run(virtual, main)


@pytest.mark.parametrize("greeting", ["QTM RT Interface connected", "QTM RT Interface connected."])
def test_the_greeting_is_compared_by_its_beginning(virtual: Any, greeting: str) -> None:
    async def main(rig: Rig) -> None:
        rig.peer.greeting = text(1, greeting)
        await rig.device.connect()
        assert rig.device.health.facts["protocol"] == "1.25"

    run(virtual, main)


def test_the_newest_version_that_both_speak(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        rig.peer.newest = "1.21"
        await rig.device.connect()
        assert rig.device.health.facts["protocol"] == "1.21"
        assert rig.peer.count("Version") == 5

    run(virtual, main)


def test_a_version_too_old_is_a_configuration_error(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        rig.peer.newest = "1.18"
        await refused(rig, ConfigurationError, "none of the protocol versions 1.19 to 1.25; update QTM")
        assert rig.device.state is ConnectionState.FAULT

    run(virtual, main)


@pytest.mark.parametrize(
    ("greeting", "kind", "match"),
    [
        (b"", ConnectionLost, "does not answer like QTM"),
        (text(1, "SSH-2.0"), ProtocolError, "greets with 'SSH-2.0'; use the little-endian port"),
        (struct.pack(">II", 35, 1) + b"QTM RT Interface connected\0", ProtocolError, "little-endian port"),
        (b"QTM RT Interface connected\r\n", ProtocolError, "22223 by default"),
        (
            text(0, "Connection refused. Max number of clients reached."),
            ConnectionLost,
            "accepts no more clients",
        ),
    ],
)
def test_wrong_ports_wrong_peers_and_the_eleventh_client(
    virtual: Any, greeting: bytes, kind: type[Exception], match: str
) -> None:
    async def main(rig: Rig) -> None:
        rig.peer.greeting = greeting
        await refused(rig, kind, match)
        rig.peer.greeting = Peer().greeting
        await rig.device.supervisor.wait_for(ConnectionState.STREAMING)

    run(virtual, main)


def test_bodies_are_renamed_and_others_left_out(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        rig.peer.names = ("0", "wand", "2")
        await rig.device.connect()
        await rig.say(frame(1, 1.0, 2.0, 3.0))
        assert set(rig.readings[0].value.poses) == {"base", "tip"}
        assert "bodies" not in rig.device.health.alarms

    run(virtual, main, bodies={"0": "base", "2": "tip"})


def test_a_body_that_qtm_does_not_have_is_an_alarm(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        (alarm,) = rig.device.health.alarms.active
        assert alarm.what == "QTM has no body 'TIP'; it has base, tip"
        await rig.say(frame(1, 1.0, 2.0))
        assert set(rig.readings[0].value.poses) == {"base"}

    run(virtual, main, bodies={"base": "base", "TIP": "tip"})


def test_changed_settings_never_put_a_name_on_another_body(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await rig.say(frame(1, 1.0, 2.0))
        rig.peer.names = ("tip", "base")
        rig.peer.send(event(11) + frame(2, 2.0, 1.0))
        await asyncio.sleep(0.01)
        await rig.say(frame(3, 1.0, 2.0))
        await asyncio.sleep(0.1)
        await rig.say(frame(4, 2.0, 1.0))
        *between, after = rig.readings[1:]
        assert len(between) == 2
        for reading in between:
            assert not reading.valid
            assert reading.flags == ("names_unknown",)
            assert reading.value.poses == {}
        assert after.value.poses["tip"].position[0] == pytest.approx(2e-3)  # type: ignore[union-attr]
        assert rig.peer.count("GetParameters") == 2

    run(virtual, main)


def test_settings_that_change_while_they_are_read_are_read_again(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        answers = [event(11) + settings("old", "names"), settings("new", "names")]
        rig.peer.answers["GetParameters General 6D"] = lambda: answers.pop(0)
        await rig.say(event(11))
        await asyncio.sleep(0.2)
        await rig.say(frame(1, 1.0, 2.0))
        assert set(rig.readings[-1].value.poses) == {"new", "names"}
        assert answers == []

    run(virtual, main)


def test_another_number_of_bodies_makes_it_read_the_names(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await rig.say(*(frame(number, 1.0, 2.0) for number in range(150)))
        rig.peer.names = ("base", "middle", "tip")
        await rig.say(frame(150, 1.0, 2.0, 3.0), frame(151, 1.0, 2.0, 3.0))
        assert [reading.valid for reading in rig.readings] == [True] * 150 + [False, True]
        assert set(rig.readings[-1].value.poses) == {"base", "middle", "tip"}

    run(virtual, main)


def test_names_that_never_fit_are_asked_for_once_a_heartbeat(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        for number in range(1, 501):
            await rig.say(frame(number, 1.0))
        assert not any(reading.valid for reading in rig.readings)
        assert 4 <= rig.peer.count("GetParameters") <= 7

    run(virtual, main)


def test_a_restart_of_the_measurement_is_a_new_epoch(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await rig.say(frame(100, 1.0, 2.0), frame(101, 1.0, 2.0), frame(1, 1.0, 2.0), frame(2, 1.0, 2.0))
        epochs = [reading.epoch for reading in rig.readings]
        assert epochs[0] == epochs[1] == epochs[2] - 1 == epochs[3] - 1
        assert all(0 <= reading.host_monotonic_ns - reading.measured_ns < 10**6 for reading in rig.readings)
        assert rig.device.health.events["measurement restarted"] == 1
        assert rig.device.health.gaps == 0

    run(virtual, main)


def test_gaps_are_counted_and_keep_their_time(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await rig.say(frame(10, 1.0, 2.0))
        await asyncio.sleep(0.03)
        await rig.say(frame(14, 1.0, 2.0))
        first, second = rig.readings
        assert rig.device.health.gaps == 3
        assert second.measured_ns - first.measured_ns == pytest.approx(40_000_000, abs=10)

    run(virtual, main)


def test_a_divisor_is_no_gap(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        assert rig.peer.commands[-1] == "StreamFrames FrequencyDivisor:4 6D"
        await rig.say(frame(4, 1.0, 2.0), frame(8, 1.0, 2.0), frame(16, 1.0, 2.0))
        assert rig.device.health.gaps == 1

    run(virtual, main, divisor=4)


def test_a_preview_that_numbers_all_frames_one_is_alive(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await rig.say(*(frame(1, 1.0, 2.0, timestamp=t * 10_000) for t in range(5)))
        assert all(reading.valid for reading in rig.readings)
        assert rig.device.health.gaps == 0

    run(virtual, main)


def test_a_picture_that_stands_still_gets_old(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        for _ in range(100):
            await rig.say(frame(1, 1.0, 2.0, timestamp=5000))
        assert [reading.valid for reading in rig.readings] == [True] + [False] * 99
        assert rig.readings[-1].flags == ("frozen",)
        last = rig.readings[-1]
        assert last.host_monotonic_ns - last.measured_ns == pytest.approx(990_000_000, rel=0.01)
        assert rig.device.state is ConnectionState.DEGRADED
        assert "stale" in rig.device.health.alarms

    run(virtual, main)


def test_a_lost_body_has_an_age_and_after_a_while_an_alarm(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await rig.say(*(frame(n, 1.0, None if n > 10 else 2.0) for n in range(1, 101)))
        last = rig.readings[-1]
        assert last.valid
        assert last.value.poses["base"] is not None
        assert last.value.lost_for_s["tip"] == pytest.approx(0.9)
        assert "lost:tip" in rig.device.health.alarms
        assert rig.device.state is ConnectionState.DEGRADED
        await rig.say(frame(101, 1.0, 2.0))
        assert rig.device.state is ConnectionState.STREAMING

    run(virtual, main)


def test_all_bodies_lost_is_no_valid_reading(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await rig.say(*(frame(n, None, None) for n in range(1, 80)))
        assert not any(reading.valid for reading in rig.readings)
        assert "stale" in rig.device.health.alarms

    run(virtual, main)


def test_closing_ends_everything(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        connection = rig.peer.connections[-1]
        await rig.device.close()
        connection.data_received(frame(1, 1.0, 2.0) + event(12))
        assert rig.readings == []
        assert rig.device.state is ConnectionState.DISCONNECTED

    run(virtual, main)


def test_two_bodies_on_one_name_are_refused() -> None:
    with pytest.raises(ValueError, match="mapped to tip"):
        QualisysConfig(name="mocap", host="h", bodies={"1": "tip", "2": "tip"})
