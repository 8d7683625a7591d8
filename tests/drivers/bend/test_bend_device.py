"""BendLabs sensors as a device: chain order, zero, restarts, absent sensors."""

from math import radians
from typing import Any

import pytest

from softarm.drivers.bend.device import BendAngles, BendConfig, BendSensors
from softarm.drivers.reading import Reading

LINE = b"1.00,2.00,3.00,4.00,5.00,6.00\r\n"


class Readings(list[Reading[BendAngles]]):
    """A sink that keeps what it gets."""

    def __call__(self, reading: Reading[BendAngles]) -> None:
        self.append(reading)


def board(**options: Any) -> tuple[BendSensors, Readings]:
    readings = Readings()
    device = BendConfig(name="bend", port="/dev/none", **options).build(readings)
    device.receive(b"torn line\r\n", 0)
    return device, readings


def degrees(*pairs: tuple[float, float]) -> Any:
    return [pytest.approx((radians(a), radians(b))) for a, b in pairs]


def test_the_first_sensor_of_a_line_is_the_last_of_the_chain() -> None:
    device, readings = board()
    device.receive(LINE, 0)
    assert list(readings[0].value.angles) == degrees((5, 6), (3, 4), (1, 2))
    device, readings = board(order="base_first")
    device.receive(LINE, 0)
    assert list(readings[0].value.angles) == degrees((1, 2), (3, 4), (5, 6))


def test_equal_lines_stay_fresh_readings() -> None:
    device, readings = board()
    for index in range(100):
        device.receive(LINE, index)
    assert len(readings) == 100
    assert all(reading.valid and not reading.flags for reading in readings)
    assert [reading.sequence for reading in readings] == list(range(100))


def test_malformed_lines_are_counted_and_never_read() -> None:
    device, readings = board()
    for line in (b"nan,0,0,0,0,0", b"ovf,0,0,0,0,0", b"1,2,3,4,5,6,7", b"1," * 400, b"999,0,0,0,0,0"):
        device.receive(line + b"\r\n", 0)
    device.receive(LINE, 0)
    assert len(readings) == 1
    assert device.health.malformed == 4
    assert device.health.rejected == 1


def test_lines_of_another_number_of_sensors_are_named_as_such() -> None:
    device, _ = board(sensors=2)
    device.receive(LINE, 0)
    assert "6 values in a line, 4 expected" in str(device.garbage())


def test_a_configured_zero_is_in_chain_order() -> None:
    device, readings = board(zero_deg=[(5.0, 6.0), (0, 0), (0, 0)])
    device.receive(LINE, 0)
    assert readings[0].value.angles[0] == pytest.approx((0, 0), abs=1e-12)


def test_a_zero_of_the_wrong_length_is_refused() -> None:
    with pytest.raises(ValueError, match="1 pairs for 3 sensors"):
        BendConfig(name="bend", port="/dev/none", zero_deg=((0.0, 0.0),))


def test_a_sensor_that_the_board_cannot_reach_is_invalid_alone() -> None:
    device, readings = board()
    device.receive(b"BendLabs two-axis sensors\r\ncannot connect to sensor 1\r\n" + LINE, 0)
    assert readings[0].valid
    assert readings[0].value.valid == (True, True, False)
    assert readings[0].flags == ("absent:1",)
    assert "absent" in device.health.alarms


def test_a_restart_of_the_board_is_a_new_epoch_and_asks_for_a_new_zero() -> None:
    device, readings = board()
    device.receive(LINE, 0)
    device.receive(b"cannot connect to sensor 2\r\n" + LINE, 0)
    device.receive(b"BendLabs two-axis sensors\r\n" + LINE, 0)
    assert [reading.flags for reading in readings] == [(), ("absent:2", "recalibrate"), ("recalibrate",)]
    assert readings[2].epoch > readings[1].epoch > readings[0].epoch
    assert "absent" not in device.health.alarms
    assert device.health.events["board restarted"] == 2


def test_no_sensor_reached_is_no_valid_reading() -> None:
    device, readings = board(sensors=1)
    device.receive(b"cannot connect to sensor 1\r\n1.00,2.00\r\n", 0)
    assert not readings[0].valid


def test_a_sensor_that_the_first_line_reports_absent_is_not_valid() -> None:
    readings = Readings()
    device = BendConfig(name="bend", port="/dev/none", dtr="reset").build(readings)
    device.receive(b"\xf0~cannot connect to sensor 2\r\n" + LINE, 0)
    (reading,) = readings
    assert reading.value.valid == (True, False, True)
    assert reading.flags == ("absent:2",)
    assert "absent" in device.health.alarms


def test_a_first_line_of_angles_may_lack_its_beginning_and_is_never_read() -> None:
    readings = Readings()
    device = BendConfig(name="bend", port="/dev/none").build(readings)
    device.receive(LINE + b"2" + LINE, 0)
    assert [reading.value.angles[2] for reading in readings] == degrees((21, 2))
