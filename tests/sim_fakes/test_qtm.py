"""The fake QTM without its sockets: replies, settings, streams, frames and their faults."""

import struct
import xml.etree.ElementTree as ET

import pytest

from softarm.fakes.faults import FaultBoard
from softarm.fakes.parts import BodyPart, QtmPart
from softarm.fakes.qtm import packets
from softarm.fakes.qtm.measurement import MotionMeasurement, measurement_faults
from softarm.fakes.qtm.packets import MeasuredFrame
from softarm.fakes.qtm.server import SERVER_FAULTS, corrupt
from softarm.fakes.qtm.session import ClientSession, parse_stream
from softarm.fakes.qtm.settings import parameters
from softarm.fakes.signals import unmodified
from softarm.fakes.still import StillArm

NAMES = ("base", "intermediate", "tip")


class Software:
    newest_version = (1, 25)
    password = "gait1"
    rate = 100.0
    last_event = 3
    last_frame = MeasuredFrame(10_000, 1, [None, None, None])
    body_names = NAMES
    master = None

    def begin(self):
        self.last_event = 3

    def end(self):
        self.last_event = 4


@pytest.fixture
def software():
    return Software()


@pytest.fixture
def session(software):
    return ClientSession(software, "192.0.2.7")


def told(reply):
    size, kind = struct.unpack_from("<II", reply)
    assert size == len(reply)
    return kind, reply[8:].rstrip(b"\0").decode()


@pytest.mark.parametrize(
    ("command", "kind", "words"),
    [
        ("Version 1.25", 1, "Version set to 1.25"),
        ("version 1.19", 1, "Version set to 1.19"),
        ("Version 1.26", 0, "Version NOT supported"),
        ("Version soon", 0, "Version NOT supported"),
        ("QTMVersion", 1, "QTM Version is 2.3 (build 464)"),
        ("ByteOrder", 1, "Byte order is little endian"),
        ("byteorder", 1, "Byte order is little endian"),
        ("GetParameters Skeleton", 0, "Parameters not available"),
        ("GetCurrentFrame 3D", 0, "Parse Error"),
        ("StreamFrames AllFrames", 0, "Parse Error"),
        ("StreamFrames Frequency:0 6D", 0, "Parse Error"),
        ("TakeControl", 0, "Wrong or missing password"),
        ("TakeControl gait1", 1, "You are now master"),
        ("ReleaseControl", 1, "You are now a regular client"),
        ("Start", 0, "You must be master to issue this command"),
        ("Reboot", 0, "Parse Error"),
        ("", 0, "Parse Error"),
    ],
)
def test_replies(session, command, kind, words):
    assert told(session.answer(command)) == (kind, words)


def test_get_state_is_an_event_and_streams_are_not_acknowledged(session):
    assert session.answer("GetState") == bytes.fromhex("09 00 00 00 06 00 00 00 03")
    assert session.answer("StreamFrames FrequencyDivisor:2 6D") == b""
    assert session.stream is not None
    assert session.answer("StreamFrames Stop") == b""
    assert session.stream is None


def test_without_a_measurement_there_is_no_more_data(session, software):
    software.last_frame = None
    assert session.answer("StreamFrames AllFrames 6D") == bytes.fromhex("08 00 00 00 04 00 00 00")
    assert session.answer("GetCurrentFrame 6D") == bytes.fromhex("08 00 00 00 04 00 00 00")
    assert session.stream is None


def test_one_master_at_a_time(session, software):
    other = ClientSession(software, "192.0.2.8")
    session.answer("TakeControl gait1")
    assert told(session.answer("TakeControl gait1")) == (1, "You are already master")
    assert told(other.answer("TakeControl gait1")) == (0, "192.0.2.7 is already master")
    assert told(session.answer("Stop")) == (1, "Stopping measurement")
    session.close()
    assert told(other.answer("TakeControl gait1")) == (1, "You are now master")


@pytest.mark.parametrize("version", [(1, 1), (1, 19), (1, 20)])
def test_old_settings(version):
    root = ET.fromstring(parameters(version, ["6d"], NAMES, 100.0))
    assert root.tag == f"QTM_Parameters_Ver_1.{version[1]:02d}"
    assert root.findtext("The_6D/Bodies") == "3"
    assert [body.findtext("Name") for body in root.iter("Body")] == list(NAMES)
    assert root.findtext("The_6D/Euler/First") == "Roll"


@pytest.mark.parametrize("version", [(1, 21), (1, 24), (1, 25)])
def test_new_settings(version):
    root = ET.fromstring(parameters(version, ["all"], ("a<b", "c"), 100.0))
    assert root.find("The_6D/Bodies") is None
    assert [body.findtext("Name") for body in root.iter("Body")] == ["a<b", "c"]
    assert (root.find("The_6D/Body/Enabled") is not None) == (version >= (1, 24))
    assert root.find("General/EulerAngles").get("First") == "Roll"
    assert root.findtext("General/Frequency") == "100"


@pytest.mark.parametrize(
    ("words", "sent"),
    [("AllFrames 6D", 60), ("FrequencyDivisor:4 6D", 15), ("Frequency:10 6D", 6), ("frequency:1000 6d", 60)],
)
def test_streams_send_their_share_of_the_frames(words, sent):
    stream = parse_stream(words, 100.0)
    assert sum(stream.due() for _ in range(60)) == sent


@pytest.mark.parametrize(
    ("words", "udp"),
    [
        ("AllFrames UDP:6734 6D", (None, 6734)),
        ("AllFrames udp:192.0.2.1:6734 6d", ("192.0.2.1", 6734)),
        ("UDP:1023 6DEuler", (None, 1023)),
    ],
)
def test_udp_streams(words, udp):
    assert parse_stream(words, 100.0).udp == udp


@pytest.mark.parametrize("words", ["UDP:80 6D", "UDP: 6D", "AllFrames 6D 7D", "UDP:6734", "Frequency:x 6D"])
def test_streams_that_cannot_be_read(words):
    assert parse_stream(words, 100.0) is None


class TestFrames:
    """Frames of the arm at rest."""

    def make(self, **cameras):
        arm = StillArm()
        faults = FaultBoard("qtm", (*SERVER_FAULTS, *measurement_faults(NAMES)))
        bodies = tuple(BodyPart(name=name, section=name) for name in NAMES)
        part = QtmPart(name="qtm", kind="qualisys", bodies=bodies, **cameras)
        return arm, faults, MotionMeasurement(part, arm.sections, {}, faults, 0, unmodified)

    def test_time_and_number_begin_with_the_measurement(self):
        arm, _, measurement = self.make()
        measurement.start(5.0)
        assert measurement.next_time() == pytest.approx(5.01)
        frames = [measurement.capture(arm.state) for _ in range(3)]
        assert [(f.time_us, f.number) for f in frames] == [(10_000, 1), (20_000, 2), (30_000, 3)]

    def test_a_fast_camera_clock_is_early(self):
        arm, _, measurement = self.make(clock_ppm=1000.0)
        for _ in range(1000):
            frame = measurement.capture(arm.state)
        assert frame.time_us == 10_000_000
        assert measurement.next_time() == pytest.approx(10.01 / 1.001)

    def test_positions_are_millimetres_with_noise_of_the_stated_size(self):
        arm, _, measurement = self.make(position_noise_m=1e-4)
        heights = [measurement.capture(arm.state).bodies[2].position[2] for _ in range(400)]
        mean = sum(heights) / 400
        assert mean == pytest.approx(-290.0, abs=0.02)
        assert sum((h - mean) ** 2 for h in heights) / 400 == pytest.approx(0.01, rel=0.3)

    def test_lost_bodies_have_all_bits_set_and_nan_bodies_do_not(self):
        arm, faults, measurement = self.make()
        faults.set("body_lost", {"bodies": "base,tip"})
        data = packets.data_packet(measurement.capture(arm.state), ["6d"])
        assert data[40:88] == data[136:184] == b"\xff" * 48
        assert b"\xff" * 8 not in data[88:136]
        faults.clear()
        faults.set("nan_body", {"bodies": "tip"})
        data = packets.data_packet(measurement.capture(arm.state), ["6d"])
        assert data[136:184] == bytes.fromhex("0000c07f") * 12
        faults.clear()
        faults.set("all_lost")
        frame = measurement.capture(arm.state)
        assert frame.bodies == [None, None, None]
        assert frame.drop_rate == 500
        assert faults.counts["body_lost"] == faults.counts["all_lost"] == 1

    def test_a_gap_leaves_frames_out(self):
        arm, faults, measurement = self.make()
        faults.set("frame_gap", {"frames": 7})
        assert measurement.capture(arm.state) is None
        assert measurement.capture(arm.state).number == 8

    def test_a_frozen_preview_repeats_frame_one(self):
        arm, faults, measurement = self.make()
        faults.set("frozen_preview")
        assert [measurement.capture(arm.state).number for _ in range(3)] == [1, 1, 1]

    def test_a_tight_loop_skips_what_is_long_past(self):
        _, _, measurement = self.make()
        measurement.skip_to(0.5)
        assert measurement.next_time() == pytest.approx(0.01)
        measurement.skip_to(3.0)
        assert 2.9 < measurement.next_time() <= 3.011


@pytest.mark.parametrize(
    ("fault", "head"),
    [
        ("zero_size", "00 00 00 00 03 00 00 00"),
        ("huge_size", "ff ff ff ff 03 00 00 00"),
        ("unknown_type", "0b 00 00 00 4d 00 00 00"),
    ],
)
def test_spoilt_headers(fault, head):
    faults = FaultBoard("qtm", SERVER_FAULTS)
    faults.set(fault)
    data = packets.data_packet(MeasuredFrame(0, 1, [None]), ["6d"])
    assert corrupt(data, faults)[:8].hex(" ") == head
    assert corrupt(data, faults) == data


@pytest.mark.parametrize(
    ("angles", "rotation"),
    [
        ((90, 0, 0), (1, 0, 0, 0, 0, 1, 0, -1, 0)),
        ((0, 90, 0), (0, 0, -1, 0, 1, 0, 1, 0, 0)),
        ((0, 0, 90), (0, 1, 0, -1, 0, 0, 0, 0, 1)),
    ],
)
def test_euler_angles_of_quarter_turns(angles, rotation):
    roll, pitch, yaw = packets.euler_angles(rotation)
    assert pitch == pytest.approx(angles[1], abs=1e-6)
    if angles[1] == 0:
        assert (roll, yaw) == pytest.approx((angles[0], angles[2]), abs=1e-6)
