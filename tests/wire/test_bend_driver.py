"""The bend-sensor driver against the fake board on a real terminal, with every fault of the matrix."""

import asyncio
from itertools import pairwise

import numpy as np
import pytest

from softarm.drivers.supervisor import ConnectionState

SPEED = 40.0
FAKE = {"name": "bend", "kind": "bendlabs", "boot_s": 0.5}
VALVES = {"name": "valves", "kind": "festo_mpa"}


def session(wire, body, *, fake=None, **driver):
    """Run ``body(rig, sensors, readings)`` with the driver connected."""
    wire.session(body, {**FAKE, **(fake or {})}, {"kind": "bendlabs", **driver}, speed=SPEED, step_s=0.02)


def test_angles_come_in_chain_order_and_radians(wire):
    async def main():
        async with wire.bench(FAKE, VALVES) as rig:
            port = str(rig.serial_ports["bend"].link)
            sensors, readings = wire.driver({"name": "bend", "kind": "bendlabs", "port": port})
            await sensors.connect()
            await wire.more(readings, 30)
            value = readings.last.value
            assert len(value.angles) == 3
            assert value.valid == (True, True, True)
            bench, upper, lower = value.angles
            dead_zone = np.radians(0.5)
            assert bench == pytest.approx((0, 0), abs=dead_zone + 0.01)
            assert upper == pytest.approx(rig.state.bends[0], abs=dead_zone + 0.01)
            assert lower == pytest.approx(rig.state.bends[1], abs=dead_zone + 0.01)
            await sensors.close()

    wire.run(main, SPEED)


def test_the_dead_zone_repeats_values_and_is_no_staleness(wire):
    async def body(rig, sensors, readings):
        fresh = await wire.more(readings, 100)
        same = sum(a.value.angles == b.value.angles for a, b in pairwise(fresh))
        assert same > 80
        assert sensors.state is ConnectionState.STREAMING
        assert not sensors.health.alarms

    session(wire, body, fake={"noise_rad": 0.0})


def test_a_sensor_that_drops_out_silently_cannot_be_seen_and_is_not_invented(wire):
    async def body(rig, sensors, readings):
        rig.inject("bend", "dropout", {"sensor": 2})
        for reading in await wire.more(readings, 50):
            assert reading.valid
        assert sensors.state is ConnectionState.STREAMING

    session(wire, body)


def test_a_restart_of_the_board_is_a_new_epoch_and_asks_for_calibration(wire):
    async def body(rig, sensors, readings):
        epoch = readings.last.epoch
        rig.inject("bend", "reboot")
        await wire.until(lambda: readings.last.epoch > epoch)
        assert "recalibrate" in readings.last.flags
        assert sensors.health.events["board restarted"] == 1
        assert sensors.health.connections == 1

    session(wire, body)


def test_a_sensor_that_cannot_be_reached_is_invalid_alone(wire):
    async def body(rig, sensors, readings):
        rig.inject("bend", "cannot_connect", {"sensor": 2})
        await wire.until(lambda: "absent" in sensors.health.alarms)
        last = (await wire.more(readings, 20))[-1]
        assert last.value.valid == (True, False, True)
        assert "absent:2" in last.flags
        rig.boards["bend"].clear()
        rig.inject("bend", "reboot")
        await wire.until(lambda: readings.last.value.valid == (True, True, True))
        assert "absent" not in sensors.health.alarms

    session(wire, body)


@pytest.mark.parametrize("kind", ["nan", "inf", "seven", "overflow", "huge", "long", "empty"])
def test_malformed_lines_are_refused_and_counted(wire, kind):
    async def body(rig, sensors, readings):
        for _ in range(3):
            rig.inject("bend", "malformed", {"kind": kind})
            await wire.more(readings, 3)
        assert rig.boards["bend"].counts["malformed"] == 3
        assert sensors.health.malformed + sensors.health.rejected == (0 if kind == "empty" else 3)
        assert sensors.health.connections == 1
        for reading in readings.valid:
            assert np.abs(np.array(reading.value.angles)).max() < 0.1

    session(wire, body)


@pytest.mark.parametrize("fault", ["torn_frame", "garbage", "stall"])
def test_a_damaged_line_costs_at_most_two_lines(wire, fault):
    async def body(rig, sensors, readings):
        for _ in range(5):
            rig.inject("bend", fault)
            await wire.more(readings, 3)
        for reading in readings.valid:
            assert np.abs(np.array(reading.value.angles)).max() < 0.1
        assert sensors.health.malformed >= (0 if fault == "stall" else 4)
        assert sensors.health.connections == 1

    session(wire, body)


def test_unplugged_and_plugged_in_again(wire):
    async def body(rig, sensors, readings):
        rig.inject("bend", "unplug")
        await sensors.supervisor.wait_for(ConnectionState.FAULT)
        epoch = readings.last.epoch
        rig.boards["bend"].clear()
        await wire.until(lambda: sensors.state is ConnectionState.STREAMING, within=10)
        last = (await wire.more(readings, 20))[-1]
        assert last.epoch > epoch
        assert "recalibrate" in last.flags
        assert sensors.health.reconnects == 1

    session(wire, body)


def test_an_arduino_that_boots_when_the_port_is_opened(wire):
    async def body(rig, sensors, readings):
        assert rig.clock.now() > 1.5
        assert "recalibrate" not in readings.last.flags
        assert sensors.health.malformed == 0

    session(wire, body, fake={"resets_on_open": True, "boot_s": 1.5})


def test_silence_is_a_stale_alarm(wire):
    async def body(rig, sensors, readings):
        rig.inject("bend", "silence")
        await wire.until(lambda: "stale" in sensors.health.alarms)
        count = len(readings.all)
        await asyncio.sleep(0.5)
        assert len(readings.all) == count
        rig.boards["bend"].clear()
        await sensors.supervisor.wait_for(ConnectionState.STREAMING)

    session(wire, body)
