"""The force-gauge drivers against fake gauges on real terminals, with every fault of the matrix."""

import asyncio

import pytest

from softarm.drivers.errors import DeviceErrors
from softarm.drivers.supervisor import ConnectionState

LUTRON = ({"kind": "lutron"}, {"kind": "lutron"})
LINE = ({"kind": "line_gauge"}, {"kind": "line_gauge"})
MARK10 = ({"kind": "mark10"}, {"kind": "mark10"})
SAUTER = ({"kind": "sauter"}, {"kind": "sauter", "unit": "N"})
ALL = pytest.mark.parametrize(
    "pair", [LUTRON, LINE, MARK10, SAUTER], ids=["lutron", "line", "mark10", "sauter"]
)
SPEED = 40.0
CORD = {"section": "tip", "hook_m": (0.0, 0.0, -0.5), "length_m": 0.209}
"""A hook below the tip at z = -0.29 m: the cord is stretched by 1 mm."""


def session(wire, body, pair, *, connect=True, **driver):
    """Run ``body(rig, gauge, readings)`` with the driver connected and the cord taut."""
    fake, table = pair
    wire.session(
        body,
        {"name": "gauge", **fake},
        {**table, **driver},
        speed=SPEED,
        connect=connect,
        cord=CORD,
        step_s=0.02,
    )


@ALL
def test_the_pull_of_the_cord_is_read_with_its_sign(wire, pair):
    async def body(rig, gauge, readings):
        for reading in await wire.more(readings, 5):
            assert reading.value.force == pytest.approx(rig.state.cord_force, abs=0.05)
            assert reading.value.force > 1.0
            assert reading.valid
        assert gauge.health.malformed == gauge.health.bad_checksum == 0

    session(wire, body, pair)


@ALL
def test_a_gauge_that_is_unplugged_comes_back_in_a_new_epoch(wire, pair):
    async def body(rig, gauge, readings):
        rig.inject("gauge", "unplug")
        await gauge.supervisor.wait_for(ConnectionState.FAULT)
        assert "was unplugged" in str(gauge.health.last_error) or "takes no" in str(gauge.health.last_error)
        epoch, count = readings.last.epoch, len(readings.all)
        await wire.until(lambda: "does not exist" in str(gauge.health.last_error))
        rig.boards["gauge"].clear()
        await wire.until(lambda: gauge.state is ConnectionState.STREAMING, within=10)
        assert all(reading.epoch > epoch for reading in (await wire.more(readings, 5)))
        assert gauge.health.reconnects == 1
        assert len(readings.all) > count

    session(wire, body, pair)


@ALL
def test_a_gauge_that_switches_itself_off_is_a_stale_alarm(wire, pair):
    async def body(rig, gauge, readings):
        rig.inject("gauge", "power_off")
        await wire.until(lambda: "stale" in gauge.health.alarms)
        assert gauge.state is ConnectionState.DEGRADED
        count = len(readings.all)
        await asyncio.sleep(0.5)
        assert len(readings.all) == count
        rig.boards["gauge"].clear()
        await gauge.supervisor.wait_for(ConnectionState.STREAMING)

    session(wire, body, pair)


@pytest.mark.parametrize("pair", [LUTRON, LINE, MARK10], ids=["lutron", "line", "mark10"])
def test_over_range_is_invalid_and_flagged(wire, pair):
    async def body(rig, gauge, readings):
        rig.inject("gauge", "over_range")
        await wire.until(lambda: "over_range" in gauge.health.alarms)
        assert not readings.last.valid
        assert "over_range" in readings.last.flags
        rig.boards["gauge"].clear()
        await wire.more(readings, 5)
        assert "over_range" not in gauge.health.alarms

    session(wire, body, pair)


@ALL
def test_zero_pressed_by_the_operator_is_an_event(wire, pair):
    async def body(rig, gauge, readings):
        rig.inject("gauge", "operator_zero")
        await wire.until(lambda: gauge.health.events["step_to_zero"] == 1)
        assert any("step_to_zero" in reading.flags for reading in readings.all)

    session(wire, body, ({**pair[0], "noise_n": 0.0}, pair[1]))


@pytest.mark.parametrize(
    ("pair", "unit"),
    [(LUTRON, "kg"), (LUTRON, "N"), (MARK10, "LB")],
    ids=["lutron kg", "lutron N", "mark10 lb"],
)
def test_another_unit_is_an_event_and_the_force_stays(wire, pair, unit):
    async def body(rig, gauge, readings):
        before = (await wire.more(readings, 5))[-1].value
        rig.inject("gauge", "unit", {"unit": unit})
        await wire.until(lambda: gauge.health.events["unit_changed"] == 1)
        after = (await wire.more(readings, 5))[-1].value
        assert after.unit != before.unit
        assert after.force == pytest.approx(before.force, abs=0.06)
        for reading in readings.valid:
            assert reading.value.force == pytest.approx(rig.state.cord_force, abs=0.08)

    session(wire, body, pair)


@ALL
@pytest.mark.parametrize("fault", ["torn_frame", "garbage", "stall"])
def test_a_damaged_line_costs_a_frame_and_gives_no_wrong_force(wire, pair, fault):
    async def body(rig, gauge, readings):
        for _ in range(3):
            rig.inject("gauge", fault)
            await wire.more(readings, 3)
        assert rig.boards["gauge"].counts[fault] == 3
        for reading in readings.valid:
            assert reading.value.force == pytest.approx(rig.state.cord_force, abs=0.05)
        if fault == "torn_frame":
            health = gauge.health
            assert health.resyncs + health.malformed + health.rejected + health.timeouts >= 2
        assert gauge.health.connections == 1

    session(wire, body, pair)


@pytest.mark.parametrize("fault", ["parity", "stale_frame", "lower_display"])
def test_lutron_frames_that_are_none(wire, fault):
    async def body(rig, gauge, readings):
        for _ in range(3):
            rig.inject("gauge", fault)
            await wire.more(readings, 3)
        assert rig.boards["gauge"].counts[fault] == 3
        assert gauge.health.resyncs + gauge.health.malformed + gauge.health.rejected >= 3
        for reading in readings.valid:
            assert reading.value.force == pytest.approx(rig.state.cord_force, abs=0.05)

    session(wire, body, LUTRON)


@pytest.mark.parametrize("kind", ["nan", "inf", "text", "long", "empty"])
def test_lines_that_are_no_number(wire, kind):
    async def body(rig, gauge, readings):
        rig.inject("gauge", "malformed", {"kind": kind}, times=3)
        await wire.more(readings, 10)
        assert gauge.health.malformed == (0 if kind == "empty" else 3)
        assert gauge.health.connections == 1

    session(wire, body, LINE)


def test_mark10_polarity_changed_in_the_menu_is_found_and_not_believed(wire):
    async def body(rig, gauge, readings):
        rig.inject("gauge", "inverted")
        await wire.until(lambda: "polarity" in gauge.health.alarms, within=8)
        await wire.until(lambda: not readings.last.valid)
        assert "settings" in readings.last.flags
        rig.boards["gauge"].clear()
        await wire.until(lambda: "polarity" not in gauge.health.alarms, within=8)

    session(wire, body, MARK10, settings_s=0.5)


def test_mark10_without_units(wire):
    async def body(rig, gauge, readings):
        rig.inject("gauge", "no_unit")
        for reading in (await wire.more(readings, 10))[5:]:
            assert reading.value.force == pytest.approx(rig.state.cord_force, abs=0.05)

    session(wire, body, MARK10)


@pytest.mark.parametrize(("pair", "fault"), [(MARK10, "refuses"), (SAUTER, "deaf")], ids=["mark10", "sauter"])
def test_a_request_that_fails_is_made_again(wire, pair, fault):
    async def body(rig, gauge, readings):
        rig.inject("gauge", fault, times=2)
        await wire.more(readings, 5)
        assert gauge.health.rejected + gauge.health.timeouts == 2
        assert gauge.health.round_trip.count > 5

    session(wire, body, pair)


@pytest.mark.parametrize(
    ("pair", "cure"), [(LUTRON, "wrong baud rate or wrong protocol"), (SAUTER, "port and baud rate")],
    ids=["lutron", "sauter"],
)  # fmt: skip
def test_a_wrong_speed_is_named(wire, pair, cure):
    async def body(rig, gauge, readings):
        with pytest.raises(DeviceErrors) as caught:
            await gauge.connect()
        (line,) = caught.value.lines()
        assert "at 19200 baud" in line
        assert f"{cure}; expected" in line

    session(wire, body, pair, connect=False, baud=19200)


def test_a_wrong_protocol_is_named(wire):
    async def body(rig, gauge, readings):
        with pytest.raises(DeviceErrors, match="not connected") as caught:
            await gauge.connect()
        assert "no valid frame in" in caught.value.lines()[0]

    session(wire, body, (LUTRON[0], {"kind": "line_gauge", "baud": 9600}), connect=False)


def test_a_gauge_that_says_nothing_is_told_from_a_wrong_speed(wire):
    async def body(rig, gauge, readings):
        rig.inject("gauge", "silence")
        with pytest.raises(DeviceErrors) as caught:
            await gauge.connect()
        assert "sends nothing at 9600 baud (limit 5.0 s); switch it on" in caught.value.lines()[0]

    session(wire, body, LUTRON, connect=False)


@ALL
def test_bit_flips_never_look_like_a_load_out_of_the_blue(wire, pair):
    """Digits have no checksum, so a flipped digit is a wrong number; what is not a digit must be refused."""

    async def body(rig, gauge, readings):
        rig.inject("gauge", "bit_flip", {"per_byte": 0.02})
        await asyncio.sleep(1.5)
        rig.boards["gauge"].clear()
        await wire.more(readings, 5)
        health = gauge.health
        assert health.resyncs + health.malformed + health.rejected + health.timeouts > 0
        assert health.failures <= 1

    session(wire, body, pair)
