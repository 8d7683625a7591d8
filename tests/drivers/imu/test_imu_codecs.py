"""Inertial units against the bytes of their datasheets."""

import struct
from math import cos, radians, sin
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from softarm.drivers.framing import FrameFault
from softarm.drivers.imu.bno08x import bno08x_codec
from softarm.drivers.imu.quaternion_line import parse_line
from softarm.drivers.imu.sample import ImuSample, Quaternion, normalised, quaternion_from_yaw_pitch_roll
from softarm.drivers.imu.witmotion import ANGLES, WitCodec, configuration, content_mask
from softarm.drivers.imu.xbus import GO_TO_CONFIG, GO_TO_MEASUREMENT, XbusMessage, encode_message, xbus_codec

Vectors = dict[str, Any]
Matrix = NDArray[np.float64]


def about(axis: int, degrees: float) -> Matrix:
    c, s = cos(radians(degrees)), sin(radians(degrees))
    turn = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
    return turn


def matrix(q: Quaternion) -> Matrix:
    w, v = q[0], np.array(q[1:])
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.asarray((w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * cross)


@pytest.mark.parametrize("angles", [(0, 0, 0), (90, 0, 0), (10, -20, 30), (-170, 80, 175), (45, 90, -45)])
def test_yaw_then_pitch_then_roll(angles: tuple[float, float, float]) -> None:
    yaw, pitch, roll = angles
    expected = about(2, yaw) @ about(1, pitch) @ about(0, roll)
    assert matrix(quaternion_from_yaw_pitch_roll(yaw, pitch, roll)) == pytest.approx(expected, abs=1e-12)


def test_rvc_frames_of_the_datasheet(vectors: Vectors) -> None:
    for vector in vectors["bno_rvc"]:
        (sample,) = bno08x_codec().feed(bytes.fromhex(vector["bytes"])).frames
        yaw, pitch, roll = vector["yaw_pitch_roll_deg"]
        expected = about(2, yaw) @ about(1, pitch) @ about(0, roll)
        assert sample.index == vector["index"]
        assert matrix(sample.quaternion) == pytest.approx(expected, abs=1e-9)
        assert sample.acceleration == pytest.approx([a * 9.80665e-3 for a in vector["acceleration_mg"]])


def test_rvc_misaligned_by_one_and_a_false_header_inside(vectors: Vectors) -> None:
    good = bytes.fromhex(vectors["bno_rvc"][0]["bytes"])
    body = struct.pack("<B6h3x", 5, 0x2AAA, 0x1111, -100, 0, 0, 1000)
    trap = b"\xaa\xaa" + body + bytes([sum(body) % 256])
    decoded = bno08x_codec().feed(b"\xaa" + good + trap + good)
    assert [sample.index for sample in decoded.frames] == [222, 5, 222]


def test_rvc_angles_that_no_unit_sends() -> None:
    body = struct.pack("<B6h3x", 0, 20000, 0, 0, 0, 0, 1000)
    codec = bno08x_codec()
    good = bytes.fromhex("aa aa 00 28 23 6c ee 00 00 00 00 00 00 e8 03 00 00 00 90")
    decoded = codec.feed(good + b"\xaa\xaa" + body + bytes([sum(body) % 256]) + good)
    assert len(decoded.frames) == 2
    assert decoded.faults[0].kind == "range"


def test_witmotion_frames_of_the_datasheet(vectors: Vectors) -> None:
    for name in ("quaternion_identity", "quaternion_quarter_turn"):
        vector = vectors["witmotion"][name]
        (sample,) = WitCodec().feed(bytes.fromhex(vector["bytes"])).frames
        assert sample.quaternion == pytest.approx(vector["quaternion"], abs=1e-4)
        assert sample.acceleration is None


def test_witmotion_assembles_acceleration_and_orientation(vectors: Vectors) -> None:
    wit = vectors["witmotion"]
    codec = WitCodec()
    assert codec.feed(bytes.fromhex(wit["acceleration"]["bytes"])).frames == []
    (sample,) = codec.feed(bytes.fromhex(wit["quaternion_identity"]["bytes"])).frames
    expected = [a * 9.80665 for a in wit["acceleration"]["acceleration_g"]]
    assert sample.acceleration == pytest.approx(expected)
    (sample,) = codec.feed(bytes.fromhex(wit["quaternion_identity"]["bytes"])).frames
    assert sample.acceleration is None
    assert codec.kinds == {0x51: 1, 0x59: 2}


def test_witmotion_angles() -> None:
    roll, pitch, yaw = 30.0, -20.0, 170.0
    body = struct.pack("<BB4h", 0x55, 0x53, *(round(a / 180 * 32768) for a in (roll, pitch, yaw)), 0)
    (sample,) = WitCodec(ANGLES).feed(body + bytes([sum(body) % 256])).frames
    expected = about(2, yaw) @ about(1, pitch) @ about(0, roll)
    assert matrix(sample.quaternion) == pytest.approx(expected, abs=2e-4)


def test_witmotion_commands() -> None:
    assert configuration(0x03, 9) == bytes.fromhex("ff aa 03 09 00")
    assert content_mask({0x51, 0x59}) == 0x0202
    assert configuration(0x02, content_mask({0x51, 0x59})) == bytes.fromhex("ff aa 02 02 02")
    assert content_mask({0x51, 0x52, 0x53, 0x54}) == 0x1E


def test_xbus_messages(vectors: Vectors) -> None:
    xbus = vectors["xbus"]
    assert encode_message(GO_TO_CONFIG) == bytes.fromhex(xbus["go_to_config"]["bytes"])
    assert encode_message(GO_TO_MEASUREMENT) == bytes.fromhex(xbus["go_to_measurement"]["bytes"])
    decoded = xbus_codec().feed(encode_message(0x31) + bytes.fromhex(xbus["data"]["bytes"]))
    acknowledge, sample = decoded.frames
    assert acknowledge == XbusMessage(0x31, b"")
    assert isinstance(sample, ImuSample)
    assert sample.index == xbus["data"]["counter"]
    assert sample.device_time == pytest.approx(xbus["data"]["sample_time"] * 1e-4)
    assert sample.quaternion == pytest.approx(xbus["data"]["quaternion"])


def test_xbus_double_precision_and_acceleration() -> None:
    groups = struct.pack(">HB4d", 0x2013, 32, 0.6, 0, 0.8, 0) + struct.pack(">HB3f", 0x4020, 12, 0, 0, 9.81)
    (sample,) = xbus_codec().feed(encode_message(0x36, groups)).frames
    assert isinstance(sample, ImuSample)
    assert sample.quaternion == pytest.approx((0.6, 0, 0.8, 0))
    assert sample.acceleration == pytest.approx((0, 0, 9.81))
    assert sample.index is None


@pytest.mark.parametrize(
    ("data", "kind"),
    [
        (b"\x10\x20\x02\x00\x07", "content"),
        (b"\x10\x20\x09\x00\x07", "framing"),
        (struct.pack(">HB4f", 0x2010, 16, 2, 0, 0, 0), "range"),
        (struct.pack(">HB4f", 0x2010, 16, float("nan"), 0, 0, 0), "range"),
    ],
)
def test_xbus_data_without_an_orientation(data: bytes, kind: str) -> None:
    codec = xbus_codec()
    codec.feed(encode_message(0x31))
    assert codec.feed(encode_message(0x36, data)).faults[0].kind == kind


def test_xbus_extended_length() -> None:
    padding = b"".join(struct.pack(">HB", 0x8020, 97) + bytes(97) for _ in range(3))
    data = struct.pack(">HB4f", 0x2010, 16, 1, 0, 0, 0) + padding
    body = b"\xff\x36\xff" + struct.pack(">H", len(data)) + data
    decoded = xbus_codec().feed(b"\xfa" + body + bytes([-sum(body) % 256]))
    assert len(decoded.frames) == 1


def test_quaternion_line_of_the_lab(vectors: Vectors) -> None:
    for vector in vectors["quaternion_line"]:
        sample = parse_line(vector["text"].strip().encode())
        assert isinstance(sample, ImuSample)
        assert sample.unit == vector["unit"]
        assert sample.quaternion == pytest.approx(vector["quaternion"], abs=1e-6)


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        (b"hello", "text"),
        (b"Quaternion of IMU 1:1.00,0.00,0.00", "value"),
        (b"Quaternion of IMU 1:nan,0.00,0.00,0.00", "value"),
        (b"Quaternion of IMU 1:0.00,0.00,0.00,0.00", "range"),
        (b"Quaternion of IMU 1:1.00,1.00,0.00,0.00", "range"),
        (b"\xffQuaternion", "text"),
    ],
)
def test_quaternion_lines_that_are_none(line: bytes, kind: str) -> None:
    fault = parse_line(line)
    assert isinstance(fault, FrameFault)
    assert fault.kind == kind


def test_normalised_refuses_what_is_no_rotation() -> None:
    assert normalised(float("inf"), 0, 0, 0, 0.1) is None
    assert normalised(1.02, 0, 0, 0, 0.03) == (1.0, 0, 0, 0)
