"""Force gauges against the bytes of their manuals."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softarm.drivers.framing import FrameFault
from softarm.drivers.gauges.line import parse_line
from softarm.drivers.gauges.lutron import lutron_codec
from softarm.drivers.gauges.mark10 import Mark10Error, Mark10Settings, mark10_codec, parse_reply
from softarm.drivers.gauges.sample import NEWTON_PER, GaugeSample, unit_named
from softarm.drivers.gauges.sauter import SauterCodec

Vectors = dict[str, Any]


def test_lutron_frames_of_the_manual(vectors: Vectors) -> None:
    for vector in vectors["lutron"]:
        (sample,) = lutron_codec().feed(bytes.fromhex(vector["bytes"])).frames
        assert sample.value == pytest.approx(vector["value"])
        assert sample.unit == vector["unit"]
        assert sample.value * NEWTON_PER[sample.unit] == pytest.approx(vector["newton"])
        assert not sample.over_range


def test_lutron_all_nines_is_over_range() -> None:
    (sample,) = lutron_codec().feed(b"\x02415700" + b"99999999\r").frames
    assert sample.over_range


@pytest.mark.parametrize("grams", [9, 99, 999])
def test_lutron_a_few_nines_are_a_weight(grams: int) -> None:
    (sample,) = lutron_codec().feed(b"\x02415700%08d\r" % grams).frames
    assert not sample.over_range
    assert sample.value == grams


def test_lutron_unknown_unit_is_a_fault_and_no_reading() -> None:
    good = b"\x0241570000000012\r"
    decoded = lutron_codec().feed(good + b"\x0241B20200000052\r" + good)
    assert [sample.value for sample in decoded.frames] == [12, 12]
    assert "unit" in [fault.kind for fault in decoded.faults]


def test_lutron_second_display_is_told_apart() -> None:
    (sample,) = lutron_codec().feed(b"\x02425700" + b"00000012\r").frames
    assert sample.display == 2


def test_mark10_readings_of_the_manual(vectors: Vectors) -> None:
    for vector in vectors["mark10"]:
        (sample,) = mark10_codec().feed(vector["text"].encode()).frames
        assert isinstance(sample, GaugeSample)
        assert sample.value == pytest.approx(vector["value"])
        assert sample.unit == unit_named(vector["unit"])


def test_mark10_settings_of_the_manual(vectors: Vectors) -> None:
    vector = vectors["mark10_list"]
    (settings_reply,) = mark10_codec().feed(vector["text"].encode()).frames
    assert isinstance(settings_reply, Mark10Settings)
    assert settings_reply.unit == vector["unit"]
    assert settings_reply.sends_polarity is vector["sends_polarity"]


@pytest.mark.parametrize("word", ["NOPOL", "INV", "IPOL"])
def test_mark10_any_other_polarity_is_not_trusted(word: str) -> None:
    reply = parse_reply(f"V1.00;N;CUR;FLTC8;FLTP1;AOUT00;AOFF5;NUM;MIT;{word};B3".encode())
    assert isinstance(reply, Mark10Settings)
    assert not reply.sends_polarity


def test_mark10_errors() -> None:
    assert parse_reply(b"*10") == Mark10Error("*10", "illegal command")
    assert isinstance(parse_reply(b"*99"), FrameFault)
    assert isinstance(parse_reply(b"4.285 psi"), FrameFault)


def test_sauter_replies_of_the_manual(vectors: Vectors) -> None:
    for vector in vectors["sauter"]:
        codec = SauterCodec()
        assert codec.feed(vector["text"].encode()) == ([], [])
        (sample,) = codec.silence().frames
        assert sample.value == pytest.approx(vector["value"])
        assert sample.unit is None


def test_sauter_a_lost_byte_never_makes_a_number_of_two_replies() -> None:
    codec = SauterCodec()
    codec.feed(b"011.70")
    assert [fault.kind for fault in codec.silence().faults] == ["torn"]
    codec.feed(b"1021.15")
    assert codec.silence().frames[0].value == pytest.approx(21.15)
    codec.feed(b"011.701021.15")
    assert [fault.kind for fault in codec.silence().faults] == ["overlong"]
    assert [fault.kind for fault in codec.silence().faults] == ["silent"]


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.lists(st.binary(max_size=20), max_size=6))
def test_sauter_any_bytes(portions: list[bytes]) -> None:
    codec, at_once = SauterCodec(), SauterCodec()
    for portion in portions:
        codec.feed(portion)
        assert len(codec._buffer) <= 7
    at_once.feed(b"".join(portions))
    outcome = codec.silence()
    assert outcome == at_once.silence()
    assert len(outcome.frames) + len(outcome.faults) == 1
    codec.feed(b"1021.15")
    assert codec.silence().frames[0].value == pytest.approx(21.15)


@pytest.mark.parametrize(
    ("line", "value", "unit", "stable"),
    [
        (b"12.34", 12.34, None, None),
        (b"-0.5 kg", -0.5, "kg", None),
        (b"+3N", 3.0, "N", None),
        (b"S S    100.00 g", 100.0, "g", True),
        (b"S D     -1.5 g", -1.5, "g", False),
        (b"ST,GS,+0012.3 g", 12.3, "g", True),
        (b"US,NT,-  4.0kg", -4.0, "kg", False),
    ],
)
def test_lines_of_boards_and_balances(
    line: bytes, value: float, unit: str | None, stable: bool | None
) -> None:
    sample = parse_line(line)
    assert isinstance(sample, GaugeSample)
    assert (sample.value, sample.unit, sample.stable) == (value, unit, stable)


@pytest.mark.parametrize("line", [b"S +", b"S -", b"OL,GS,+9999 g"])
def test_overload_of_balances(line: bytes) -> None:
    sample = parse_line(line)
    assert isinstance(sample, GaugeSample)
    assert sample.over_range


@pytest.mark.parametrize(
    "line", [b"nan", b"inf", b"1e5", b"", b"12.3.4", b"S I", b"12 furlongs", b"\xff\xfe", b"0x12"]
)
def test_lines_that_are_no_reading(line: bytes) -> None:
    assert isinstance(parse_line(line), FrameFault)


def test_the_column_of_a_table() -> None:
    sample = parse_line(b"1234,0.55,21.5", separator=",", column=1)
    assert isinstance(sample, GaugeSample)
    assert sample.value == 0.55
    assert isinstance(parse_line(b"1234", separator=",", column=1), FrameFault)


def test_every_unit_is_its_weight_in_newton() -> None:
    assert NEWTON_PER["kg"] == pytest.approx(9.80665)
    assert NEWTON_PER["lb"] == pytest.approx(0.45359237 * 9.80665)
    assert NEWTON_PER["oz"] == pytest.approx(NEWTON_PER["lb"] / 16)
    assert NEWTON_PER["g"] * 1000 == pytest.approx(NEWTON_PER["kg"])
