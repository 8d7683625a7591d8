"""What holds for every codec of a serial instrument, whatever comes over the line."""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softarm.drivers.bend.bendlabs import bend_codec
from softarm.drivers.framing import Codec, Decoded
from softarm.drivers.gauges.line import line_gauge_codec
from softarm.drivers.gauges.lutron import lutron_codec
from softarm.drivers.gauges.mark10 import mark10_codec
from softarm.drivers.imu.bno08x import bno08x_codec
from softarm.drivers.imu.quaternion_line import quaternion_line_codec
from softarm.drivers.imu.witmotion import ANGLES, WitCodec
from softarm.drivers.imu.xbus import xbus_codec

words = st.integers(-(2**15), 2**15 - 1)


def total(data: bytes) -> bytes:
    return bytes([sum(data) % 256])


def rvc(index: int, yaw: int, pitch: int, roll: int) -> bytes:
    body = struct.pack("<B6h3x", index, yaw, pitch, roll, 1, 2, 1000)
    return b"\xaa\xaa" + body + total(body)


def lutron(digits: int, decimals: int, negative: bool) -> bytes:
    return b"\x0241" + b"57" + b"%d%d%08d\r" % (negative, decimals, digits)


def wit(roll: int, pitch: int, yaw: int) -> bytes:
    body = struct.pack("<BB4h", 0x55, 0x53, roll, pitch, yaw, 0)
    return body + total(body)


def xbus(counter: int, quaternion: Sequence[float]) -> bytes:
    data = struct.pack(">HBH", 0x1020, 2, counter) + struct.pack(">HB4f", 0x2010, 16, *quaternion)
    body = bytes([0xFF, 0x36, len(data)]) + data
    return b"\xfa" + body + bytes([-sum(body) % 256])


def bend(angles: Sequence[float]) -> bytes:
    return ",".join(f"{angle:.2f}" for angle in angles).encode() + b"\r\n"


unit_quaternions = st.sampled_from([(1.0, 0.0, 0.0, 0.0), (0.6, 0.0, 0.8, 0.0), (0.5, -0.5, 0.5, -0.5)])


@dataclass(frozen=True)
class Case:
    """A codec, an encoder of its frames that is not ours, and the most bytes that it may hold."""

    codec: Callable[[], Codec[Any]]
    frames: st.SearchStrategy[bytes]
    bound: int
    joined: bytes = b""

    def __repr__(self) -> str:
        return "case"


CASES = {
    "lutron": Case(
        lutron_codec, st.builds(lutron, st.integers(0, 9998), st.integers(0, 3), st.booleans()), 16
    ),
    "bno08x": Case(
        bno08x_codec,
        st.builds(
            rvc,
            st.integers(0, 255),
            st.integers(-18000, 18000),
            st.integers(-9000, 9000),
            st.integers(-18000, 18000),
        ),
        19,
    ),
    "witmotion": Case(lambda: WitCodec(ANGLES), st.builds(wit, words, words, words), 11),
    "xbus": Case(xbus_codec, st.builds(xbus, st.integers(0, 65535), unit_quaternions), 2055),
    "mark10": Case(
        mark10_codec,
        st.builds(lambda value: b"%.3f lbF\r\n" % value, st.floats(-20, 20)),
        160,
    ),
    "line": Case(
        line_gauge_codec, st.builds(lambda value: b"%.2f\r\n" % value, st.floats(-5000, 5000)), 128, b"\n"
    ),
    "bendlabs": Case(
        bend_codec,
        st.lists(st.floats(-120, 120), min_size=6, max_size=6).map(bend),
        128,
        b"\n",
    ),
    "quaternion_line": Case(
        quaternion_line_codec,
        unit_quaternions.map(
            lambda q: b"Quaternion of IMU 1:" + ",".join(f"{x:.2f}" for x in q).encode() + b"\r\n"
        ),
        128,
        b"\n",
    ),
}

each_codec = pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
quick = settings(max_examples=25, deadline=None, derandomize=True)


def pieces(data: bytes, cuts: Sequence[int]) -> list[bytes]:
    places = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return [data[a:b] for a, b in pairwise(places)]


def held(codec: Any) -> int:
    """Count the bytes that a codec holds of a frame that is not complete."""
    return len(getattr(codec, "lines", getattr(codec, "frames", codec))._buffer)


def feed_all(codec: Codec[Any], portions: Sequence[bytes], bound: int = 10**9) -> Decoded[Any]:
    whole: Decoded[Any] = Decoded([], [])
    for portion in portions:
        decoded = codec.feed(portion)
        whole.frames.extend(decoded.frames)
        whole.faults.extend(decoded.faults)
        assert held(codec) <= bound
    return whole


def without_fault_text(decoded: Decoded[Any]) -> tuple[list[Any], list[str]]:
    return decoded.frames, [fault.kind for fault in decoded.faults]


@each_codec
def test_any_bytes_in_any_portions_give_the_same_frames_and_faults(case: Case) -> None:
    noise = st.one_of(
        st.binary(max_size=60), case.frames, st.sampled_from([b"\x02", b"\xaa\xaa", b"\n", b"\x55"])
    )

    @quick
    @given(st.lists(noise, max_size=8).map(b"".join), st.lists(st.integers(0, 5000), max_size=8))
    def check(stream: bytes, cuts: list[int]) -> None:
        at_once, in_portions, by_byte = case.codec(), case.codec(), case.codec()
        expected = without_fault_text(feed_all(at_once, [stream], case.bound))
        for codec, portions in (
            (in_portions, pieces(stream, cuts)),
            (by_byte, [stream[i : i + 1] for i in range(len(stream))]),
        ):
            assert without_fault_text(feed_all(codec, portions, case.bound)) == expected
            assert codec.counts == at_once.counts
        assert at_once.counts.received == len(stream)
        assert at_once.counts.skipped <= len(stream)

    check()


@each_codec
def test_every_good_frame_arrives_without_a_fault(case: Case) -> None:
    @quick
    @given(st.lists(case.frames, min_size=1, max_size=8), st.lists(st.integers(0, 5000), max_size=8))
    def check(frames: list[bytes], cuts: list[int]) -> None:
        decoded = feed_all(case.codec(), pieces(case.joined + b"".join(frames), cuts))
        assert len(decoded.frames) == len(frames)
        assert decoded.faults == []

    check()


@each_codec
def test_damage_costs_the_frame_it_hits_and_at_most_the_next(case: Case) -> None:
    @quick
    @given(
        st.lists(case.frames, min_size=6, max_size=7),
        st.integers(1, 3),
        st.integers(0, 10**6),
        st.sampled_from(["flip", "drop", "insert", "truncate"]),
        st.integers(0, 7),
    )
    def check(frames: list[bytes], hit: int, place: int, damage: str, bit: int) -> None:
        expected = feed_all(case.codec(), [case.joined + b"".join(frames)]).frames
        victim = bytearray(frames[hit])
        at = place % len(victim)
        if damage == "flip":
            victim[at] ^= 1 << bit
        elif damage == "drop":
            del victim[at]
        elif damage == "insert":
            victim.insert(at, 0x80 | bit)
        else:
            del victim[at:]
        stream = case.joined + b"".join([*frames[:hit], bytes(victim), *frames[hit + 1 :]])
        decoded = feed_all(case.codec(), [stream, b"\n" * 300 if case.joined else bytes(300)])
        survivors = expected[hit + 2 :]
        assert decoded.frames[:hit] == expected[:hit]
        assert decoded.frames[-len(survivors) :] == survivors

    check()


@each_codec
def test_a_stream_joined_in_mid_frame_gives_only_whole_frames(case: Case) -> None:
    @quick
    @given(st.lists(case.frames, min_size=4, max_size=6), st.integers(1, 10**6))
    def check(frames: list[bytes], place: int) -> None:
        expected = feed_all(case.codec(), [case.joined + b"".join(frames)]).frames
        lost = 1 + place % (len(frames[0]) - 1)
        decoded = feed_all(case.codec(), [b"".join(frames)[lost:]])
        assert decoded.frames[-2:] == expected[-2:]
        assert not case.joined or decoded.frames == expected[1:]

    check()


@each_codec
def test_garbage_is_counted_since_the_last_good_frame(case: Case) -> None:
    codec = case.codec()
    codec.feed(b"\xf1" * 5000)
    assert codec.counts.since_frame == 5000
    assert codec.counts.received == 5000
    assert held(codec) <= case.bound
    codec.reset()
    assert held(codec) == 0
