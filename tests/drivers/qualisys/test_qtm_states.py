"""The QTM client against a scripted peer, in virtual time: waiting, silence, loss, odd packets."""

import asyncio
import struct
from typing import Any

import pytest

from softarm.drivers.errors import ConfigurationError
from softarm.drivers.supervisor import ConnectionState
from tests.drivers.qualisys.qtm_peer import Rig, event, frame, packet, refused, run, text


def test_no_more_data_waits_and_a_capture_starts_the_stream_again(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await rig.say(frame(5, 1.0, 2.0))
        rig.peer.running = False
        await rig.say(packet(4), event(4))
        assert rig.device.state is ConnectionState.DEGRADED
        assert "waiting" in rig.device.health.alarms
        asked = rig.peer.count("StreamFrames")
        rig.peer.running = True
        await rig.say(event(3))
        assert rig.peer.count("StreamFrames") == asked + 1
        await asyncio.sleep(0.1)
        await rig.say(frame(1, 1.0, 2.0))
        assert rig.device.state is ConnectionState.STREAMING
        assert rig.readings[-1].epoch == rig.readings[0].epoch + 1
        assert rig.device.health.connections == 1

    run(virtual, main)


def test_no_measurement_at_connect_waits_and_asks_again(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        rig.peer.running = False
        await rig.device.connect()
        await asyncio.sleep(5.5)
        assert "waiting" in rig.device.health.alarms
        assert rig.device.state is ConnectionState.DEGRADED
        assert 5 <= rig.peer.count("StreamFrames") <= 7
        rig.peer.running = True
        await asyncio.sleep(1.1)
        await rig.say(frame(1, 1.0, 2.0))
        await asyncio.sleep(0.1)
        await rig.say(frame(2, 1.0, 2.0))
        assert rig.device.state is ConnectionState.STREAMING

    run(virtual, main)


def test_shutting_down_and_coming_back(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await rig.say(frame(500, 1.0, 2.0), event(12))
        assert rig.device.state is ConnectionState.FAULT
        assert "QTM is shutting down; start QTM" in str(rig.device.health.last_error)
        await rig.device.supervisor.wait_for(ConnectionState.STREAMING)
        await rig.say(frame(1, 1.0, 2.0))
        assert rig.readings[-1].epoch > rig.readings[0].epoch
        assert rig.device.health.reconnects == 1

    run(virtual, main)


def test_silence_is_asked_about_and_no_answer_is_a_loss(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await asyncio.sleep(5.5)
        assert 4 <= rig.peer.count("GetState") - 1 <= 5
        assert rig.device.health.failures == 0
        rig.peer.mute = True
        rig.peer.greeting = b""
        await rig.device.supervisor.wait_for(ConnectionState.FAULT)
        assert "does not answer GetState (limit 1.0 s)" in str(rig.device.health.last_error)
        assert rig.device.health.timeouts == 1

    run(virtual, main)


def test_an_unanswered_question_is_no_loss_while_frames_come(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        rig.peer.mute = True
        await asyncio.sleep(1.5)
        rig.peer.mute = False
        await rig.say(*(frame(number, 1.0, 2.0) for number in range(1, 200)))
        assert rig.device.health.timeouts == 1
        assert rig.device.health.failures == 0
        await rig.say(event(4), event(11))
        assert rig.device.health.events["capture stopped"] == 1
        assert rig.device.health.events["camera settings changed"] == 1

    run(virtual, main)


def test_a_peer_that_dies_while_waiting_is_noticed(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        rig.peer.running = False
        await rig.device.connect()
        await asyncio.sleep(3)
        rig.peer.mute = True
        async with asyncio.timeout(5):
            await rig.device.supervisor.wait_for(ConnectionState.FAULT)

    run(virtual, main)


@pytest.mark.parametrize("header", [(0, 3), (0xFFFFFFFF, 3), (7, 1), (0xFFFFFFFF, 77)])
def test_a_hostile_header_drops_the_connection_and_is_counted(virtual: Any, header: tuple[int, int]) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await rig.say(frame(1, 1.0, 2.0), struct.pack("<II", *header) + bytes(100))
        assert rig.peer.aborted == 1
        assert rig.device.health.malformed == 1
        assert "not in step, or not QTM" in str(rig.device.health.last_error)
        await rig.device.supervisor.wait_for(ConnectionState.STREAMING)

    run(virtual, main)


def test_unknown_packets_and_broken_components_are_counted_and_passed_over(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        broken = bytearray(frame(2, 1.0, 2.0))
        broken[24:28] = struct.pack("<I", 9999)
        unasked = text(1, "hello")
        await rig.say(packet(77, bytes(50)), bytes(broken), unasked, frame(3, 1.0, 2.0), packet(3, bytes(16)))
        assert [reading.sequence for reading in rig.readings] == [3]
        health = rig.device.health
        assert (health.events["unknown packets"], health.malformed, health.rejected) == (1, 1, 1)
        assert health.events["frames without bodies"] == 1
        assert rig.device.state is ConnectionState.STREAMING

    run(virtual, main)


def test_a_refused_stream_is_told(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        rig.peer.refuse_stream = True
        await rig.device.connect()
        await rig.device.supervisor.wait_for(ConnectionState.FAULT)
        assert "refuses the stream: 'Parse Error'" in str(rig.device.health.last_error)

    run(virtual, main)


def test_settings_that_are_not_there_yet(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        rig.peer.answers["GetParameters General 6D"] = lambda: text(0, "Parameters not available")
        await rig.device.connect()
        assert "names" in rig.device.health.alarms
        await rig.say(frame(1, 1.0, 2.0))
        assert not rig.readings[0].valid
        del rig.peer.answers["GetParameters General 6D"]
        await asyncio.sleep(2)
        await rig.say(frame(2, 1.0, 2.0))
        assert rig.readings[-1].valid
        assert "names" not in rig.device.health.alarms

    run(virtual, main)


def test_angles_of_another_convention_are_refused(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        rig.peer.euler = "Heading"
        await refused(rig, ConfigurationError, "QTM names its angles Heading, Pitch, Yaw")

    run(virtual, main, component="6DEuler")


def test_the_stream_of_angles(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        body = struct.pack("<6f", 100, 0, 0, 0, 0, 90)
        component = struct.pack("<IIIhh", 16 + 48, 6, 2, 3, 4) + body + b"\xff" * 24
        await rig.say(packet(3, struct.pack("<qII", 1, 1, 1) + component))
        value = rig.readings[0].value
        assert value.poses["base"].quaternion == pytest.approx((0.5**0.5, 0, 0, 0.5**0.5))  # type: ignore[union-attr]
        assert (value.poses["tip"], value.drop_rate, value.out_of_sync_rate) == (None, 3, 4)

    run(virtual, main, component="6DEuler")
