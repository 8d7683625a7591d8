"""Packets of the Qualisys protocol: bytes of the manual, hostile headers, any split."""

import struct
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from qtm_rt.packet import QRTPacketType
from qtm_rt.receiver import Receiver

from softarm.drivers.framing import FrameFault
from softarm.drivers.qualisys.bodies import BodyFrame, Component, decode_bodies
from softarm.drivers.qualisys.discovery import QtmHost, encode_discover, parse_reply
from softarm.drivers.qualisys.packets import Packet, PacketKind, PacketParser, encode_command, packet_text

Vectors = dict[str, Any]
quick = settings(max_examples=60, deadline=None, derandomize=True)
LOST = b"\xff" * 4


def packet(kind: int, body: bytes) -> bytes:
    return struct.pack("<II", 8 + len(body), kind) + body


def data_packet(*components: bytes, timestamp: int = 0, frame: int = 1, count: int | None = None) -> bytes:
    head = struct.pack("<qII", timestamp, frame, len(components) if count is None else count)
    return packet(3, head + b"".join(components))


def bodies(kind: int, rows: list[list[float]], drop: int = 0, out_of_sync: int = 0) -> bytes:
    body = b"".join(struct.pack(f"<{len(row)}f", *row) for row in rows)
    return struct.pack("<IIIhh", 16 + len(body), kind, len(rows), drop, out_of_sync) + body


def feed_all(parser: PacketParser, portions: list[bytes]) -> tuple[list[Packet], list[str]]:
    packets: list[Packet] = []
    kinds: list[str] = []
    for portion in portions:
        decoded = parser.feed(portion)
        packets += decoded.frames
        kinds += [fault.kind for fault in decoded.faults]
    return packets, kinds


def test_packets_of_the_manual(vectors: Vectors) -> None:
    qtm = vectors["qtm"]
    assert (
        encode_command("Version 1.25")
        == bytes.fromhex(qtm["version"]["bytes"]) + qtm["version"]["text"].encode()
    )
    stream = qtm["stream"]
    assert (
        encode_command("StreamFrames AllFrames 6D")
        == bytes.fromhex(stream["bytes"]) + stream["text"].encode()
    )
    welcome = bytes.fromhex(qtm["welcome"]["bytes"]) + qtm["welcome"]["text"].encode()
    no_more = bytes.fromhex(qtm["no_more_data"]["bytes"])
    event = bytes.fromhex(qtm["event_connected"]["bytes"])
    packets, faults = feed_all(PacketParser(), [welcome + no_more + event])
    assert faults == []
    assert [kind for kind, _ in packets] == [PacketKind.COMMAND, PacketKind.NO_MORE_DATA, PacketKind.EVENT]
    assert packet_text(packets[0][1]) == "QTM RT Interface connected"
    assert packets[2][1][8] == 1
    assert encode_discover(qtm["discover"]["reply_port"]) == bytes.fromhex(qtm["discover"]["bytes"])


def test_a_6d_frame_of_the_manual(vectors: Vectors) -> None:
    vector = vectors["qtm"]["frame_6d"]
    ((kind, whole),) = PacketParser().feed(bytes.fromhex(vector["bytes"])).frames
    frame = decode_bodies(whole)
    assert kind == PacketKind.DATA
    assert isinstance(frame, BodyFrame)
    assert (frame.timestamp_us, frame.frame, len(frame.values)) == (
        vector["timestamp_us"],
        vector["frame"],
        vector["bodies"],
    )
    assert frame.values[0].tolist() == vector["position_mm"] + vector["rotation"]
    assert np.isnan(frame.values[1]).all()


@pytest.mark.parametrize(
    ("header", "what"),
    [
        ((0, 3), "zero"),
        ((7, 1), "shorter than its header"),
        ((0xFFFFFFFF, 3), "four gigabytes"),
        ((0xFFFFFFFF, 77), "four gigabytes of an unknown kind"),
        ((2 << 20, 3), "data beyond a megabyte"),
        ((23, 3), "data without its head"),
        ((10, 6), "an event of two bytes"),
        ((9, 4), "no more data, with data"),
    ],
)
def test_a_size_that_cannot_be_ends_the_stream(header: tuple[int, int], what: str) -> None:
    parser = PacketParser()
    good = packet(6, b"\x01")
    packets, faults = feed_all(parser, [good + struct.pack("<II", *header), good * 1000])
    assert packets == [(6, good)], what
    assert faults == ["size"]
    assert parser.broken


def test_unknown_kinds_are_passed_over_without_being_kept() -> None:
    parser = PacketParser()
    good = packet(6, b"\x01")
    large = packet(42, bytes(1 << 20))
    packets, faults = feed_all(parser, [good + large[:1000], large[1000:500_000], large[500_000:] + good])
    assert packets == [(6, good)] * 2
    assert faults == ["unknown"]


wire_packets = st.one_of(
    st.binary(max_size=40).map(lambda body: packet(1, body)),
    st.integers(0, 20).map(lambda event: packet(6, bytes([event]))),
    st.just(packet(4, b"")),
    st.binary(max_size=60).map(lambda body: packet(99, body)),
    st.integers(0, 3).map(lambda n: data_packet(bodies(5, [[1.0] * 12] * n))),
)


@quick
@given(st.lists(wire_packets, max_size=8), st.lists(st.integers(0, 5000), max_size=8))
def test_any_split_gives_the_same_packets(packets: list[bytes], cuts: list[int]) -> None:
    stream = b"".join(packets)
    expected = feed_all(PacketParser(), [stream])
    places = [0, *sorted(cut % (len(stream) + 1) for cut in cuts), len(stream)]
    assert feed_all(PacketParser(), [stream[a:b] for a, b in pairwise(places)]) == expected
    assert feed_all(PacketParser(), [stream[i : i + 1] for i in range(len(stream))]) == expected
    assert [whole for _, whole in expected[0]] == [whole for whole in packets if whole[4] != 99]


@quick
@given(st.lists(st.binary(max_size=80), max_size=6))
def test_any_bytes(portions: list[bytes]) -> None:
    parser = PacketParser()
    for portion in portions:
        for kind, whole in parser.feed(portion).frames:
            if kind == PacketKind.DATA:
                decode_bodies(whole)
    assert len(parser._buffer) < 8 << 20


@quick
@given(st.data())
def test_any_damage_to_a_data_packet(data: st.DataObject) -> None:
    whole = bytearray(data_packet(bodies(5, [[1.0] * 12] * 2), bodies(1, [[2.0] * 3])))
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(8, len(whole) - 1))] = data.draw(st.integers(0, 255))
    end = data.draw(st.integers(0, len(whole)))
    outcome = decode_bodies(bytes(whole[:end]))
    assert outcome is None or isinstance(outcome, BodyFrame | FrameFault)


ROWS = {
    Component.SIX_D: [*(1.0, 2.0, 3.0), *(1, 0, 0, 0, 1, 0, 0, 0, 1)],
    Component.SIX_D_RESIDUAL: [*(1.0, 2.0, 3.0), *(1, 0, 0, 0, 1, 0, 0, 0, 1), 0.5],
    Component.SIX_D_EULER: [1.0, 2.0, 3.0, 10.0, 20.0, 30.0],
    Component.SIX_D_EULER_RESIDUAL: [1.0, 2.0, 3.0, 10.0, 20.0, 30.0, 0.5],
}


@pytest.mark.parametrize("kind", list(Component))
@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("count", [0, 1, 3])
def test_each_kind_of_bodies_alone_and_after_others(kind: Component, first: bool, count: int) -> None:
    component = bodies(kind, [ROWS[kind]] * count, drop=12, out_of_sync=-1)
    markers = struct.pack("<IIIhh", 16 + 12, 1, 1, 0, 0) + bytes(12)
    whole = data_packet(component, markers) if first else data_packet(markers, component)
    frame = decode_bodies(whole)
    assert isinstance(frame, BodyFrame)
    assert (frame.component, frame.drop_rate, frame.out_of_sync_rate) == (kind, 12, -1)
    assert frame.values.tolist() == [pytest.approx(ROWS[kind])] * count


def test_packets_without_bodies_and_components_that_lie() -> None:
    markers = struct.pack("<II", 16, 1) + bytes(8)
    assert decode_bodies(data_packet()) is None
    assert decode_bodies(data_packet(markers)) is None
    assert isinstance(decode_bodies(data_packet(markers, count=1000)), FrameFault)
    assert isinstance(decode_bodies(data_packet(struct.pack("<IIIhh", 16, 5, 10**9, 0, 0))), FrameFault)
    assert isinstance(decode_bodies(data_packet(markers, struct.pack("<II", 9999, 1))), FrameFault)
    assert isinstance(decode_bodies(data_packet(markers, struct.pack("<II", 0, 1))), FrameFault)
    assert isinstance(decode_bodies(data_packet(markers, struct.pack("<II", 12, 5) + bytes(4))), FrameFault)


def test_the_public_client_reads_the_same_numbers() -> None:
    rows = [[float(10 * i + j) for j in range(12)] for i in range(3)]
    whole = data_packet(bodies(5, rows, drop=3), timestamp=123_456, frame=77)
    seen: list[Any] = []
    Receiver({QRTPacketType.PacketData: seen.append}).data_received(whole)
    header, theirs = seen[0].get_6d()
    ours = decode_bodies(whole)
    assert isinstance(ours, BodyFrame)
    assert (seen[0].timestamp, seen[0].framenumber) == (ours.timestamp_us, ours.frame)
    assert header.drop_rate == ours.drop_rate
    assert [[*position, *rotation.matrix] for position, rotation in theirs] == ours.values.tolist()


def test_discovery_replies() -> None:
    text = b"Host, QTM 2.5 (build 568), 5 cameras\0"
    reply = struct.pack("<II", 10 + len(text), 1) + text + struct.pack(">H", 22222)
    assert parse_reply(reply, "10.0.0.1") == QtmHost("10.0.0.1", 22222, text[:-1].decode())
    for damaged in (reply[:-1], reply[:8], b"", reply.replace(b"\0\x56", b"aa"), bytes(4000)):
        assert isinstance(parse_reply(damaged, "10.0.0.1"), FrameFault)


@quick
@given(st.binary(max_size=100))
def test_any_discovery_reply(data: bytes) -> None:
    assert isinstance(parse_reply(data, "::1"), QtmHost | FrameFault)
