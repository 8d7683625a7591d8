"""The lab's BendLabs line."""

from typing import Any

import pytest

from softarm.drivers.bend.bendlabs import BendLine, BendStatus, bend_codec, parse_line
from softarm.drivers.framing import FrameFault


def test_lines_of_the_sketch(vectors: dict[str, Any]) -> None:
    for vector in vectors["bendlabs_line"]:
        (line,) = bend_codec().feed(b"half a line\n" + vector["text"].encode()).frames
        if "degrees" in vector:
            assert isinstance(line, BendLine)
            assert line.angles_deg == pytest.approx(vector["degrees"])
        else:
            assert isinstance(line, BendStatus)
            assert line.absent_sensor == vector["absent_sensor"]


def test_equal_lines_are_all_readings() -> None:
    decoded = bend_codec().feed(b"\n" + b"1.00,2.00,3.00,4.00,5.00,6.00\r\n" * 50)
    assert len(decoded.frames) == 50
    assert decoded.faults == []


def test_the_first_line_is_torn_and_dropped() -> None:
    decoded = bend_codec().feed(b"0,2.00,3.00,4.00,5.00,6.00\r\n1.00,2.00,3.00,4.00,5.00,6.00\r\n")
    assert len(decoded.frames) == 1
    assert decoded.faults == []


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        (b"nan,2.00,3.00,4.00,5.00,6.00", "value"),
        (b"inf,2.00,3.00,4.00,5.00,6.00", "value"),
        (b"ovf,2.00,3.00,4.00,5.00,6.00", "value"),
        (b"1.00,2.00,3.00,4.00,5.00,6.00,7.00", "fields"),
        (b"1.00,2.00,3.00,4.00,5.00", "fields"),
        (b"1.00,2.00,3.00,4.00,5.00,", "value"),
        (b"999.99,2.00,3.00,4.00,5.00,6.00", "range"),
        (b"1e3,2.00,3.00,4.00,5.00,6.00", "value"),
        (b"nan", "fields"),
        (b"\xffabc", "text"),
        (b"a\x07bc", "text"),
    ],
)
def test_malformed_lines_are_refused_by_kind(line: bytes, kind: str) -> None:
    fault = parse_line(line)
    assert isinstance(fault, FrameFault)
    assert fault.kind == kind


@pytest.mark.parametrize("text", ["Starting up", "Bendlabs demo v1.2", "sensor init OK"])
def test_text_of_the_start_is_a_status(text: str) -> None:
    assert parse_line(text.encode()) == BendStatus(text, None)


def test_two_sensors() -> None:
    assert parse_line(b"1.00,2.00,3.00,4.00", sensors=2) == BendLine((1.0, 2.0, 3.0, 4.0))
