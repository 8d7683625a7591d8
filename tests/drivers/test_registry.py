"""The configuration of devices: every error at once, each with its place and its cure."""

import pytest

from softarm.drivers.errors import DeviceErrors
from softarm.drivers.registry import KINDS, load_devices

VALVES = {
    "name": "valves",
    "kind": "festo_mpa",
    "host": "192.0.2.1",
    "chambers": [3, 2, 1, 0, 4, 5],
    "maximum_pa": 5e4,
}


def errors(*tables):
    with pytest.raises(DeviceErrors) as caught:
        load_devices(tables, "arm.toml: devices")
    return caught.value.lines()


def test_a_good_table_gives_its_device():
    (config,) = load_devices([VALVES])
    device = config.build()
    assert (device.name, device.source) == ("valves", "modbus+tcp://192.0.2.1:502")
    assert device.limits.maximum == (50_000.0,) * 6


def test_a_fake_says_so_in_its_source():
    (config,) = load_devices([{**VALVES, "simulated": True}])
    assert config.build().source == "fake+modbus+tcp://192.0.2.1:502"


def test_every_kind_is_named_after_its_model():
    for kind, model in KINDS.items():
        assert kind in str(model.model_fields["kind"].annotation)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"chambers": [3, 2, 1, 0, 4, 3]}, "chambers 0 and 5 are both mapped to valve 3"),
        ({"chambers": [3, 2, 1, 0, 4, 16]}, "chamber 5 names valve 16, but they run from 0 to 15"),
        ({"maximum_pa": [5e4, 5e4]}, "2 entries for 6 chambers"),
        ({"maximum_pa": 4e6}, "exceeds the 3.2767e+06 Pa"),
        ({"maximum_pa": -1.0}, "greater than 0"),
        ({"watchdog_ms": 50}, "greater than or equal to 100 (value 50)"),
        ({"watchdog_ms": 100, "rate_hz": 10}, "less than 3 passes (300 ms)"),
        ({"port": 70000}, "port: input should be less than or equal to 65535 (value 70000)"),
        ({"hots": "x"}, "nearest known is 'host'"),
        ({"response_timeout_s": 3.0}, "less than or equal to 0.1"),
        ({"kind": "festo_map"}, "nearest is 'festo_mpa'"),
        ({"kind": 7}, "kind 7 is unknown"),
        ({"name": "Big Valves"}, "pattern"),
    ],
)
def test_each_mistake_is_told_with_its_place(change, told):
    (line,) = errors({**VALVES, **change})
    assert told in line
    assert line.startswith("arm.toml: devices[0]")


def test_all_mistakes_are_told_at_once():
    broken = {**VALVES, "port": 0, "hots": 1}
    del broken["host"]
    assert len(errors(broken, {"kind": "toaster"}, VALVES, VALVES)) == 5


def test_a_table_that_is_none_is_told():
    assert "is not a table" in errors("valves")[0]
