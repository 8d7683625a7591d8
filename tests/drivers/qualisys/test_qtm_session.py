"""The QTM client against a scripted peer, in virtual time: every turn that a session can take."""

import asyncio
import struct
from collections.abc import Callable
from typing import Any

import pytest

from drivers.errors import ConfigurationError, ConnectionLost, DeviceErrors, ProtocolError
from drivers.qualisys.connection import Connection, Refused
from drivers.qualisys.device import MotionCapture, QualisysConfig
from drivers.qualisys.motion import MotionFrame
from drivers.qualisys.packets import PacketKind
from drivers.qualisys.session import QtmSession
from drivers.reading import Reading
from drivers.supervisor import State

IDENTITY = [1.0, 0, 0, 0, 1, 0, 0, 0, 1]


def packet(kind: int, body: bytes = b"") -> bytes:
    return struct.pack("<II", 8 + len(body), kind) + body


def text(kind: int, words: str) -> bytes:
    return packet(kind, words.encode() + b"\0")


def event(number: int) -> bytes:
    return packet(6, bytes([number]))


def frame(number: int, *x_mm: float | None, timestamp: int | None = None) -> bytes:
    rows = [struct.pack("<12f", x, 0, 0, *IDENTITY) if x is not None else b"\xff" * 48 for x in x_mm]
    component = struct.pack("<IIIhh", 16 + 48 * len(rows), 5, len(rows), 0, 0) + b"".join(rows)
    microseconds = number * 10_000 if timestamp is None else timestamp
    return packet(3, struct.pack("<qII", microseconds, number, 1) + component)


def settings(*names: str, euler: str = "Roll") -> bytes:
    bodies = "".join(f"<Body><Name>{name}</Name></Body>" for name in names)
    general = f'<General><EulerAngles First="{euler}" Second="Pitch" Third="Yaw"/></General>'
    return text(2, f"<QTM_Parameters_Ver_1.25>{general}<The_6D>{bodies}</The_6D></QTM_Parameters_Ver_1.25>")


class Peer:
    """Answers as QTM does, unless told otherwise."""

    def __init__(self) -> None:
        self.greeting = text(1, "QTM RT Interface connected")
        self.newest = "1.25"
        self.names: tuple[str, ...] = ("base", "tip")
        self.euler = "Roll"
        self.running = True
        self.mute = False
        self.refuse_stream = False
        self.commands: list[str] = []
        self.answers: dict[str, Callable[[], bytes]] = {}
        self.connections: list[Connection] = []
        self.aborted = 0

    def connect(self, connection: Connection) -> None:
        self.connections.append(connection)
        connection.connection_made(PeerTransport(self, connection))  # type: ignore[arg-type]
        self.send(self.greeting)

    def send(self, data: bytes) -> None:
        asyncio.get_running_loop().call_soon(self.connections[-1].data_received, data)

    def command(self, words: str) -> None:
        self.commands.append(words)
        if not self.mute and (answer := self.answer(words)):
            self.send(answer)

    def answer(self, words: str) -> bytes:
        if words in self.answers:
            return self.answers[words]()
        if words.startswith("Version"):
            known = float(words.split()[1]) <= float(self.newest)
            return (
                text(1, f"Version set to {words.split()[1]}") if known else text(0, "Version NOT supported")
            )
        if words == "QTMVersion":
            return text(1, "QTM Version is 2.3 (build 464)")
        if words == "GetState":
            return event(3 if self.running else 4)
        if words.startswith("GetParameters"):
            return settings(*self.names, euler=self.euler)
        if words.startswith("StreamFrames") and not words.endswith("Stop"):
            return text(0, "Parse Error") if self.refuse_stream else b"" if self.running else packet(4)
        return b""

    def count(self, start: str) -> int:
        return sum(words.startswith(start) for words in self.commands)


class PeerTransport:
    """What a connection writes to."""

    def __init__(self, peer: Peer, connection: Connection) -> None:
        self._peer = peer
        self._connection = connection

    def write(self, data: bytes) -> None:
        size, kind = struct.unpack_from("<II", data)
        assert (size, kind) == (len(data), 1)
        self._peer.command(data[8:-1].decode())

    def abort(self) -> None:
        self._peer.aborted += 1

    def close(self) -> None:
        pass


class Capture(MotionCapture):
    """A motion capture whose connection leads to a scripted peer."""

    peer: Peer

    async def open(self) -> QtmSession:
        connection = Connection(self.name, self.clock)
        self.peer.connect(connection)
        return QtmSession(self.name, connection, self._publisher, self.health, self._options, self.clock)


class Rig:
    """Device and peer."""

    def __init__(self, virtual: Any, **options: Any) -> None:
        self.readings: list[Reading[MotionFrame]] = []
        self.peer = Peer()
        config = QualisysConfig(name="mocap", host="10.0.0.1", **options)
        self.device = Capture(config, self.readings.append, virtual.clock)
        self.device.peer = self.peer

    async def say(self, *packets: bytes) -> None:
        """Send packets one hundredth of a second apart, and let them be worked off."""
        for data in packets:
            self.peer.send(data)
            await asyncio.sleep(0.01)


def run(virtual: Any, main: Callable[[Rig], Any], **options: Any) -> None:
    async def whole() -> None:
        rig = Rig(virtual, **options)
        try:
            await main(rig)
        finally:
            await rig.device.close()

    virtual.run(whole)


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


async def refused(rig: Rig, kind: type[Exception], match: str) -> None:
    with pytest.raises(DeviceErrors) as caught:
        await rig.device.connect()
    (error,) = caught.value.leaves()
    assert isinstance(error, kind)
    assert match in str(error)


def test_a_version_too_old_is_a_configuration_error(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        rig.peer.newest = "1.18"
        await refused(rig, ConfigurationError, "none of the protocol versions 1.19 to 1.25; update QTM")
        assert rig.device.state is State.FAULT

    run(virtual, main)


@pytest.mark.parametrize(
    ("greeting", "kind", "match"),
    [
        (b"", ConnectionLost, "does not greet as QTM does"),
        (text(1, "SSH-2.0"), ProtocolError, "greets with 'SSH-2.0'; use the little-endian port"),
        (struct.pack(">II", 35, 1) + b"QTM RT Interface connected\0", ProtocolError, "little-endian port"),
        (b"QTM RT Interface connected\r\n", ProtocolError, "22223 by default"),
        (
            text(0, "Connection refused. Max number of clients reached."),
            ConnectionLost,
            "takes no more clients",
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
        await rig.device.supervisor.wait_for(State.STREAMING)

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
        (alarm,) = rig.device.health.alarms.standing
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
        assert all(0 <= reading.age_ns(reading.host_monotonic_ns) < 10**6 for reading in rig.readings)
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
        assert last.age_ns(last.host_monotonic_ns) == pytest.approx(990_000_000, rel=0.01)
        assert rig.device.state is State.DEGRADED
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
        assert rig.device.state is State.DEGRADED
        await rig.say(frame(101, 1.0, 2.0))
        assert rig.device.state is State.STREAMING

    run(virtual, main)


def test_all_bodies_lost_is_no_valid_reading(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await rig.say(*(frame(n, None, None) for n in range(1, 80)))
        assert not any(reading.valid for reading in rig.readings)
        assert "stale" in rig.device.health.alarms

    run(virtual, main)


def test_no_more_data_waits_and_a_capture_starts_the_stream_again(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await rig.say(frame(5, 1.0, 2.0))
        rig.peer.running = False
        await rig.say(packet(4), event(4))
        assert rig.device.state is State.DEGRADED
        assert "waiting" in rig.device.health.alarms
        asked = rig.peer.count("StreamFrames")
        rig.peer.running = True
        await rig.say(event(3))
        assert rig.peer.count("StreamFrames") == asked + 1
        await asyncio.sleep(0.1)
        await rig.say(frame(1, 1.0, 2.0))
        assert rig.device.state is State.STREAMING
        assert rig.readings[-1].epoch == rig.readings[0].epoch + 1
        assert rig.device.health.connections == 1

    run(virtual, main)


def test_no_measurement_at_connect_waits_and_asks_again(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        rig.peer.running = False
        await rig.device.connect()
        await asyncio.sleep(5.5)
        assert "waiting" in rig.device.health.alarms
        assert rig.device.state is State.DEGRADED
        assert 5 <= rig.peer.count("StreamFrames") <= 7
        rig.peer.running = True
        await asyncio.sleep(1.1)
        await rig.say(frame(1, 1.0, 2.0))
        await asyncio.sleep(0.1)
        await rig.say(frame(2, 1.0, 2.0))
        assert rig.device.state is State.STREAMING

    run(virtual, main)


def test_shutting_down_and_coming_back(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await rig.say(frame(500, 1.0, 2.0), event(12))
        assert rig.device.state is State.FAULT
        assert "QTM is shutting down; start QTM" in str(rig.device.health.last_error)
        await rig.device.supervisor.wait_for(State.STREAMING)
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
        await rig.device.supervisor.wait_for(State.FAULT)
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
            await rig.device.supervisor.wait_for(State.FAULT)

    run(virtual, main)


@pytest.mark.parametrize("header", [(0, 3), (0xFFFFFFFF, 3), (7, 1), (0xFFFFFFFF, 77)])
def test_a_hostile_header_drops_the_connection_and_is_counted(virtual: Any, header: tuple[int, int]) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        await rig.say(frame(1, 1.0, 2.0), struct.pack("<II", *header) + bytes(100))
        assert rig.peer.aborted == 1
        assert rig.device.health.malformed == 1
        assert "not in step, or not QTM" in str(rig.device.health.last_error)
        await rig.device.supervisor.wait_for(State.STREAMING)

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
        assert rig.device.state is State.STREAMING

    run(virtual, main)


def test_a_refused_stream_is_told(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        rig.peer.refuse_stream = True
        await rig.device.connect()
        await rig.device.supervisor.wait_for(State.FAULT)
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


def connected(virtual: Any) -> tuple[Peer, Connection]:
    peer = Peer()
    connection = Connection("mocap", virtual.clock)
    peer.connect(connection)
    return peer, connection


def test_open_requests_fail_at_once_when_the_connection_is_lost(virtual: Any) -> None:
    async def main() -> None:
        peer, connection = connected(virtual)
        await connection.welcome()
        peer.mute = True
        asking = [
            asyncio.create_task(connection.request("QTMVersion", PacketKind.COMMAND)),
            asyncio.create_task(connection.request("GetParameters 6D", PacketKind.XML)),
        ]
        await asyncio.sleep(0)
        connection.connection_lost(ConnectionResetError("reset by peer"))
        before = virtual.clock()
        outcomes = await asyncio.gather(*asking, return_exceptions=True)
        assert virtual.clock() == before
        assert all(isinstance(outcome, ConnectionLost) for outcome in outcomes)
        with pytest.raises(ConnectionLost, match="reset by peer"):
            await connection.request("QTMVersion", PacketKind.COMMAND)

    virtual.run(main)


def test_the_answer_of_a_request_that_was_given_up_reaches_nobody_else(virtual: Any) -> None:
    async def main() -> None:
        peer, connection = connected(virtual)
        await connection.welcome()
        peer.mute = True
        given_up = asyncio.create_task(connection.request("QTMVersion", PacketKind.COMMAND))
        await asyncio.sleep(0)
        given_up.cancel()
        refused = asyncio.create_task(connection.request("Version 9.9", PacketKind.COMMAND))
        wanted = asyncio.create_task(connection.request("ByteOrder", PacketKind.COMMAND))
        await asyncio.sleep(0)
        peer.send(text(1, "late") + text(0, "Version NOT supported") + text(1, "Byte order is little endian"))
        assert b"little endian" in await wanted
        with pytest.raises(Refused, match="Version NOT supported"):
            await refused

    virtual.run(main)


def test_data_never_answers_a_request(virtual: Any) -> None:
    async def main() -> None:
        peer, connection = connected(virtual)
        await connection.welcome()
        peer.answers["QTMVersion"] = lambda: frame(1, 1.0) + event(11) + text(1, "QTM Version is 2.3")
        assert b"2.3" in await connection.request("QTMVersion", PacketKind.COMMAND)

    virtual.run(main)


def test_closing_ends_everything(virtual: Any) -> None:
    async def main(rig: Rig) -> None:
        await rig.device.connect()
        connection = rig.peer.connections[-1]
        await rig.device.close()
        connection.data_received(frame(1, 1.0, 2.0) + event(12))
        assert rig.readings == []
        assert rig.device.state is State.DISCONNECTED

    run(virtual, main)


def test_two_bodies_on_one_name_are_refused() -> None:
    with pytest.raises(ValueError, match="mapped to tip"):
        QualisysConfig(name="mocap", host="h", bodies={"1": "tip", "2": "tip"})
