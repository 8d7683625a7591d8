"""Each sensor has the deadline that its device can keep."""

import pytest

from softarm.daemon.config import ServiceConfig, Setup
from softarm.daemon.control.deadlines import deadlines_s
from softarm.drivers.registry import load_devices
from tests.service.standins import CONFIG, SPECIMEN

UNIT = {"name": "unit", "kind": "quaternion_line", "port": "/dev/ttyUSB0", "unit": 2, "rate_hz": 8}
FAST = {"name": "fast", "kind": "xbus", "port": "/dev/ttyUSB1"}
GAUGE = {"name": "gauge", "kind": "lutron", "port": "/dev/ttyUSB2"}


def deadlines(*sensors):
    config = ServiceConfig.model_validate(CONFIG | {"sensors": sensors})
    devices = load_devices([UNIT, FAST, GAUGE])
    return deadlines_s(Setup(None, "", config, SPECIMEN, devices))


def sensor(device, **more):
    kind = "gauge" if device == "gauge" else "orientation"
    return {"kind": kind, "section": "tip", "device": device, **more}


def test_a_slow_unit_may_leave_out_two_readings() -> None:
    assert deadlines(sensor("unit")) == {"unit": pytest.approx(3 / 8)}


def test_a_fast_unit_has_the_common_deadline() -> None:
    assert deadlines(sensor("fast")) == {"fast": 0.15}


def test_a_gauge_is_late_when_its_driver_says_so() -> None:
    assert deadlines(sensor("gauge")) == {"gauge": 0.5}


def test_the_configuration_has_the_last_word() -> None:
    assert deadlines(sensor("unit", deadline_s=0.2)) == {"unit": 0.2}
