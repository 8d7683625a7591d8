"""The drivers of inertial units against fake units on real terminals, with every fault of the matrix."""

import asyncio

import numpy as np
import pytest

from softarm.drivers.errors import DeviceErrors
from softarm.drivers.supervisor import ConnectionState

SPEED = 40.0
BNO = ({"kind": "bno08x_rvc"}, {"kind": "bno08x_rvc"})
WIT = ({"kind": "witmotion", "baud": 115200}, {"kind": "witmotion", "rate_hz": 50})
XBUS = ({"kind": "xbus"}, {"kind": "xbus"})
LINE = ({"kind": "quaternion_line"}, {"kind": "quaternion_line", "unit": 2, "rate_hz": 8})
ALL = pytest.mark.parametrize("pair", [BNO, WIT, XBUS, LINE], ids=["bno", "wit", "xbus", "line"])
BINARY = pytest.mark.parametrize("pair", [BNO, WIT, XBUS], ids=["bno", "wit", "xbus"])
COUNTED = pytest.mark.parametrize("pair", [BNO, XBUS], ids=["bno", "xbus"])


def session(wire, body, pair, *, connect=True, **driver):
    """Run ``body(rig, imu, readings)`` with the driver connected."""
    fake, table = pair
    fake = {"name": "imu", "noise_rad": 1e-4, **fake}
    wire.session(body, fake, {**table, **driver}, speed=SPEED, connect=connect, step_s=0.02)


def tilt(quaternion):
    """Direction of the third axis, which does not depend on the heading, shape (3,)."""
    w, x, y, z = quaternion
    return np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])


def check(rig, reading, tolerance=0.02):
    assert np.linalg.norm(reading.value.quaternion) == pytest.approx(1.0)
    assert tilt(reading.value.quaternion) == pytest.approx(tilt(rig.state.quaternions[2]), abs=tolerance)


@ALL
def test_orientations_arrive(wire, pair):
    async def body(rig, imu, readings):
        for reading in await wire.more(readings):
            check(rig, reading)
        assert imu.state is ConnectionState.STREAMING
        assert imu.health.gaps == imu.health.bad_checksum == imu.health.malformed == 0

    session(wire, body, pair)


@BINARY
@pytest.mark.parametrize("fault", ["bad_checksum", "byte_slip"])
def test_a_damaged_frame_is_counted_and_costs_one_frame(wire, pair, fault):
    async def body(rig, imu, readings):
        for _ in range(3):
            rig.inject("imu", fault)
            await wire.more(readings, 4)
        assert rig.boards["imu"].counts[fault] == 3
        assert imu.health.bad_checksum + imu.health.resyncs >= 3
        assert imu.health.gaps <= 6
        for reading in readings.valid:
            check(rig, reading)

    session(wire, body, pair)


def test_a_false_header_is_seen_through(wire):
    async def body(rig, imu, readings):
        rig.inject("imu", "false_header")
        await wire.until(lambda: rig.boards["imu"].counts["false_header"] >= 1, within=5)
        await wire.more(readings)
        assert imu.health.gaps == 0

    session(wire, body, BNO)


@COUNTED
def test_a_jump_of_the_index_is_lost_samples(wire, pair):
    async def body(rig, imu, readings):
        epoch = readings.last.epoch
        rig.inject("imu", "index_gap", {"frames": 5})
        await wire.until(lambda: imu.health.gaps)
        assert imu.health.gaps == 5
        await wire.more(readings)
        assert readings.last.epoch == epoch
        numbers = [reading.sequence for reading in readings.all]
        assert numbers == sorted(set(numbers))

    session(wire, body, pair)


@COUNTED
def test_a_restart_of_the_unit_is_a_new_epoch(wire, pair):
    async def body(rig, imu, readings):
        await wire.more(readings, 40)
        epoch = readings.last.epoch
        rig.inject("imu", "reset")
        await wire.until(lambda: readings.last.epoch > epoch)
        fresh = await wire.more(readings, 20)
        assert {reading.epoch for reading in fresh} == {epoch + 1}
        assert imu.health.events["unit restarted"] == 1
        assert imu.health.connections == 1

    session(wire, body, pair)


def test_a_wrong_rate_is_an_alarm_with_both_rates(wire):
    async def body(rig, imu, readings):
        rig.inject("imu", "wrong_rate", {"hz": 25.0})
        await wire.until(lambda: "rate" in imu.health.alarms, within=6)
        (alarm,) = [alarm for alarm in imu.health.alarms.active if alarm.key == "rate"]
        assert alarm.limit == 100.0
        rig.boards["imu"].clear()
        await wire.until(lambda: "rate" not in imu.health.alarms, within=6)

    session(wire, body, BNO)


def test_a_wit_unit_of_the_factory_is_set_and_not_stored(wire):
    async def body(rig, imu, readings):
        assert imu.health.events["configured"] == 1
        fresh = await wire.more(readings, 50)
        elapsed = fresh[-1].host_monotonic_ns - fresh[0].host_monotonic_ns
        assert 49 / (elapsed * 1e-9) == pytest.approx(50, rel=0.1)
        assert fresh[-1].value.acceleration is not None

    session(wire, body, WIT)


def test_a_wit_unit_that_forgets_is_set_again(wire):
    async def body(rig, imu, readings):
        rig.inject("imu", "forgets")
        await wire.until(lambda: imu.health.events["configured"] == 2, within=8)
        await wire.more(readings, 50)
        await wire.until(lambda: "content" not in imu.health.alarms, within=8)

    session(wire, body, WIT)


def test_a_wit_unit_that_is_locked_is_told_until_somebody_unlocks_it(wire):
    async def body(rig, imu, readings):
        rig.inject("imu", "locked")
        with pytest.raises(DeviceErrors) as caught:
            await imu.connect()
        (line,) = caught.value.lines()
        assert "the unit sends 0x51 at 10 Hz" in line
        assert "set the unit to 0x51, 0x59 at 50 Hz" in line
        rig.boards["imu"].clear()
        await wire.until(lambda: imu.state is ConnectionState.STREAMING, within=10)

    session(wire, body, WIT, connect=False)


def test_only_looking_changes_no_setting(wire):
    async def main():
        async with wire.bench({"name": "imu", **WIT[0]}) as rig:
            port = str(rig.serial_ports["imu"].link)
            imu, _ = wire.driver({"name": "imu", "port": port, **WIT[1]}, observe=True)
            with pytest.raises(DeviceErrors):
                await imu.connect()
            assert imu.health.events["configured"] == 0
            await imu.close()

    wire.run(main, SPEED)


def test_an_xbus_unit_in_its_configuration_state_is_asked_to_measure(wire):
    async def body(rig, imu, readings):
        rig.inject("imu", "config_mode")
        await wire.until(lambda: "stale" in imu.health.alarms)
        await wire.until(lambda: imu.health.events["asked to measure"] == 1)
        await imu.supervisor.wait_for(ConnectionState.STREAMING)

    session(wire, body, XBUS)


def test_an_xbus_error_is_counted(wire):
    async def body(rig, imu, readings):
        rig.inject("imu", "error")
        await wire.until(lambda: imu.health.rejected == 1)
        await wire.more(readings)

    session(wire, body, XBUS)


def test_xbus_times_follow_the_clock_of_the_unit(wire):
    async def body(rig, imu, readings):
        fresh = await wire.more(readings, 100)
        steps = np.diff([reading.device_time_ns for reading in fresh])
        assert steps == pytest.approx(np.full(99, 1e7), abs=2e5)
        assert all(reading.host_monotonic_ns - reading.measured_ns >= 0 for reading in fresh)

    session(wire, body, XBUS)


def test_a_sketch_that_restarts_is_a_new_epoch(wire):
    async def body(rig, imu, readings):
        epoch = readings.last.epoch
        rig.inject("imu", "reset")
        await wire.until(lambda: readings.last.epoch == epoch + 1)
        assert imu.health.events["unit restarted"] == 1

    session(wire, body, LINE)


@pytest.mark.parametrize("kind", ["three", "zero", "nan", "text"])
def test_lines_that_are_no_quaternion(wire, kind):
    async def body(rig, imu, readings):
        rig.inject("imu", "malformed", {"kind": kind})
        await wire.until(lambda: imu.health.malformed + imu.health.rejected == 1)
        await wire.more(readings, 3)

    session(wire, body, LINE)


@ALL
def test_unplugged_and_plugged_in_again(wire, pair):
    async def body(rig, imu, readings):
        rig.inject("imu", "unplug")
        await imu.supervisor.wait_for(ConnectionState.FAULT)
        epoch = readings.last.epoch
        rig.boards["imu"].clear()
        await wire.until(lambda: imu.state is ConnectionState.STREAMING, within=15)
        assert (await wire.more(readings, 3))[0].epoch > epoch
        assert imu.health.reconnects == 1

    session(wire, body, pair)


@ALL
def test_silence_is_a_stale_alarm(wire, pair):
    async def body(rig, imu, readings):
        rig.inject("imu", "silence")
        await wire.until(lambda: "stale" in imu.health.alarms, within=5)
        rig.boards["imu"].clear()
        await imu.supervisor.wait_for(ConnectionState.STREAMING)

    session(wire, body, pair)


@pytest.mark.parametrize("pair", [BNO, XBUS, LINE], ids=["bno", "xbus", "line"])
def test_a_wrong_speed_is_named(wire, pair):
    async def body(rig, imu, readings):
        with pytest.raises(DeviceErrors) as caught:
            await imu.connect()
        assert "no valid frame in" in caught.value.lines()[0]
        assert "wrong baud rate or wrong protocol" in caught.value.lines()[0]

    session(wire, body, pair, connect=False, baud=19200)


@ALL
def test_a_bad_line_gives_no_orientation_that_is_none(wire, pair):
    async def body(rig, imu, readings):
        rig.inject("imu", "byte_loss", {"per_byte": 0.02})
        await asyncio.sleep(2)
        rig.boards["imu"].clear()
        await wire.more(readings, 3)
        health = imu.health
        assert health.bad_checksum + health.resyncs + health.malformed + health.rejected > 0
        for reading in readings.valid:
            assert np.linalg.norm(reading.value.quaternion) == pytest.approx(1.0)

    session(wire, body, pair)
