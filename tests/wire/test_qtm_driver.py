"""The motion-capture driver against the fake QTM on a real port, with every fault of the matrix."""

import asyncio

import pytest

from softarm.drivers.errors import DeviceErrors
from softarm.drivers.qualisys.discovery import discover
from softarm.drivers.supervisor import ConnectionState

FAKE = {"name": "qtm", "kind": "qualisys", "rate_hz": 100.0}
SPEED = 30.0
NAMES = {"base", "intermediate", "tip"}


def session(wire, body, *, connect=True, fake=None, **driver):
    """Run ``body(rig, capture, readings)`` with the driver connected."""
    fake = {**FAKE, **(fake or {})}
    wire.session(body, fake, {"kind": "qualisys", **driver}, speed=SPEED, connect=connect, step_s=0.01)


def check_tip(rig, reading):
    """The pose is that of the body it is named after, wherever it stood in the packet."""
    for index, name in enumerate(("base", "intermediate", "tip")):
        pose = reading.value.poses.get(name)
        if pose is not None:
            assert pose.position == pytest.approx(rig.state.positions[index], abs=1e-3)


def test_poses_arrive_with_names_and_times(wire):
    async def body(rig, capture, readings):
        for reading in await wire.more(readings, 50):
            assert set(reading.value.poses) == NAMES
            check_tip(rig, reading)
        numbers = [reading.sequence for reading in readings.all]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
        assert capture.health.gaps == 0
        assert capture.health.facts["bodies"] == "base, intermediate, tip"
        first, last = readings.all[5], readings.all[45]
        device = last.device_time_ns - first.device_time_ns
        assert last.measured_ns - first.measured_ns == pytest.approx(device, abs=3e6)

    session(wire, body)


@pytest.mark.parametrize("component", ["6DRes", "6DEuler", "6DEulerRes"])
def test_the_other_components_carry_the_same_poses(wire, component):
    async def body(rig, capture, readings):
        reading = readings.valid[-1]
        check_tip(rig, reading)
        tip = reading.value.poses["tip"]
        w, x, y, z = tip.quaternion
        assert abs(x * 1.0) == pytest.approx(1.0, abs=0.01)
        assert (w, y, z) == pytest.approx((0, 0, 0), abs=0.02)
        assert (tip.residual is not None) == component.endswith("Res")

    session(wire, body, component=component)


@pytest.mark.parametrize("version", ["1.25", "1.21", "1.20", "1.19"])
def test_every_protocol_version(wire, version):
    async def body(rig, capture, readings):
        assert capture.health.facts["protocol"] == version
        assert set(readings.valid[-1].value.poses) == NAMES

    session(wire, body, fake={"newest_version": version})


def test_a_protocol_too_old(wire):
    async def body(rig, capture, readings):
        with pytest.raises(DeviceErrors) as caught:
            await capture.connect()
        (line,) = caught.value.lines()
        assert line.startswith("qtm: QTM speaks none of the protocol versions 1.19 to 1.25; update QTM")
        await wire.until(lambda: not capture.supervisor.retrying)

    session(wire, body, connect=False, fake={"newest_version": "1.18"})


@pytest.mark.parametrize("fault", ["body_lost", "nan_body"])
def test_a_lost_body_is_none_with_its_age_and_the_others_go_on(wire, fault):
    async def body(rig, capture, readings):
        rig.inject("qtm", fault, {"bodies": "intermediate"})
        await wire.until(lambda: "lost:intermediate" in capture.health.alarms)
        last = readings.last
        assert last.valid
        assert last.value.poses["intermediate"] is None
        assert last.value.poses["tip"] is not None
        assert last.value.lost_for_s["intermediate"] >= 0.5
        assert "lost:intermediate" in last.flags
        assert capture.state is ConnectionState.DEGRADED
        rig.boards["qtm"].clear()
        await capture.supervisor.wait_for(ConnectionState.STREAMING)
        assert rig.boards["qtm"].counts[fault] > 0

    session(wire, body)


def test_all_bodies_lost_degrades_after_the_deadline(wire):
    async def body(rig, capture, readings):
        rig.inject("qtm", "all_lost")
        await wire.until(lambda: "stale" in capture.health.alarms)
        assert not readings.last.valid
        assert readings.last.value.drop_rate == 500
        assert all(pose is None for pose in readings.last.value.poses.values())
        rig.boards["qtm"].clear()
        await capture.supervisor.wait_for(ConnectionState.STREAMING)

    session(wire, body)


def test_a_gap_is_counted_and_passed_on_with_the_true_time(wire):
    async def body(rig, capture, readings):
        rig.inject("qtm", "frame_gap", {"frames": 7})
        await wire.until(lambda: capture.health.gaps)
        assert capture.health.gaps == 7
        pairs = zip(readings.all, readings.all[1:], strict=False)
        (jump,) = [(a, b) for a, b in pairs if b.sequence - a.sequence > 1]
        assert jump[1].sequence - jump[0].sequence == 8
        assert jump[1].device_time_ns - jump[0].device_time_ns == pytest.approx(80e6, abs=1e4)
        assert len({reading.epoch for reading in readings.all}) == 1

    session(wire, body)


@pytest.mark.parametrize("announced", [False, True])
def test_a_restarted_measurement_is_a_new_epoch_with_a_fresh_clock_map(wire, announced):
    async def body(rig, capture, readings):
        await wire.more(readings, 100)
        epoch = readings.last.epoch
        rig.inject("qtm", "restart", {"announced": announced})
        await wire.until(lambda: readings.valid[-1].epoch > epoch)
        fresh = await wire.more(readings, 20)
        assert fresh[0].sequence < 60
        assert {reading.epoch for reading in fresh} == {epoch + 1}
        assert all(reading.host_monotonic_ns - reading.measured_ns < 20e6 for reading in fresh)
        assert capture.health.connections == 1

    session(wire, body)


def test_no_more_data_waits_and_the_next_capture_streams_again(wire):
    async def body(rig, capture, readings):
        rig.inject("qtm", "no_more_data")
        await wire.until(lambda: "waiting" in capture.health.alarms)
        assert capture.state is ConnectionState.DEGRADED
        count = len(readings.all)
        await asyncio.sleep(2)
        assert len(readings.all) == count
        rig.boards["qtm"].clear()
        await wire.more(readings)
        assert "waiting" not in capture.health.alarms
        assert capture.health.connections == 1

    session(wire, body)


@pytest.mark.parametrize("action", ["rotate", "remove"])
def test_changed_settings_rename_and_never_mislabel(wire, action):
    async def body(rig, capture, readings):
        rig.inject("qtm", "settings_changed", {"action": action})
        await wire.until(lambda: capture.health.events["body names read"] == 2)
        left = NAMES if action == "rotate" else NAMES - {"tip"}
        fresh = await wire.more(readings, 20)
        assert set(fresh[-1].value.poses) == left
        for reading in readings.valid:
            check_tip(rig, reading)
        assert any("names_unknown" in reading.flags for reading in readings.all)

    session(wire, body)


def test_shutting_down_is_a_loss_and_the_driver_comes_back(wire):
    async def body(rig, capture, readings):
        rig.inject("qtm", "shutdown")
        await capture.supervisor.wait_for(ConnectionState.FAULT)
        assert "QTM is shutting down" in str(capture.health.last_error)
        epoch = readings.last.epoch
        await wire.until(lambda: "cannot be reached" in str(capture.health.last_error))
        rig.boards["qtm"].clear()
        await wire.until(lambda: capture.state is ConnectionState.STREAMING, within=10)
        await wire.more(readings)
        assert readings.last.epoch > epoch
        assert capture.health.reconnects == 1

    session(wire, body)


def test_a_reset_connection_comes_back(wire):
    async def body(rig, capture, readings):
        rig.inject("qtm", "reset_connection")
        await capture.supervisor.wait_for(ConnectionState.FAULT)
        await capture.supervisor.wait_for(ConnectionState.STREAMING)
        await wire.more(readings)
        assert capture.health.failures == 1

    session(wire, body)


@pytest.mark.parametrize("fault", ["zero_size", "huge_size"])
def test_a_hostile_header_costs_one_connection(wire, fault):
    async def body(rig, capture, readings):
        rig.inject("qtm", fault)
        await capture.supervisor.wait_for(ConnectionState.FAULT)
        assert "not in step, or not QTM" in str(capture.health.last_error)
        assert capture.health.malformed == 1
        await capture.supervisor.wait_for(ConnectionState.STREAMING)
        await wire.more(readings)

    session(wire, body)


def test_unknown_packets_and_broken_components_are_counted(wire):
    async def body(rig, capture, readings):
        rig.inject("qtm", "unknown_type")
        rig.inject("qtm", "truncated_component", times=2)
        await wire.until(lambda: capture.health.malformed == 2)
        await wire.until(lambda: capture.health.events["unknown packets"] == 1)
        await wire.more(readings)
        assert capture.health.connections == 1

    session(wire, body)


@pytest.mark.parametrize("fault", ["split", "coalesce"])
def test_segments_do_not_matter(wire, fault):
    async def body(rig, capture, readings):
        rig.inject("qtm", fault)
        await wire.more(readings, 40)
        assert rig.boards["qtm"].counts[fault]
        assert capture.health.malformed == capture.health.gaps == 0

    session(wire, body)


def test_a_frozen_preview_gets_old(wire):
    async def body(rig, capture, readings):
        rig.inject("qtm", "frozen_preview")
        await wire.until(lambda: "stale" in capture.health.alarms)
        assert "frozen" in readings.last.flags
        assert readings.last.host_monotonic_ns - readings.last.measured_ns > 0.4e9
        assert not readings.last.valid

    session(wire, body)


def test_latency_shows_in_the_age(wire):
    async def body(rig, capture, readings):
        await wire.more(readings, 50)
        rig.inject("qtm", "latency", {"seconds": 0.2})
        late = await wire.until(
            lambda: [r for r in readings.all if r.host_monotonic_ns > r.measured_ns + 0.15e9]
        )
        assert late[0].epoch == readings.all[0].epoch

    session(wire, body)


def test_silence_is_noticed_and_survived(wire):
    async def body(rig, capture, readings):
        rig.inject("qtm", "silence")
        await wire.until(lambda: "stale" in capture.health.alarms)
        await wire.until(lambda: capture.state is ConnectionState.FAULT, within=5)
        assert "does not answer GetState" in str(capture.health.last_error)
        rig.boards["qtm"].clear()
        await wire.until(lambda: capture.state is ConnectionState.STREAMING, within=10)
        await wire.more(readings)

    session(wire, body)


def test_the_eleventh_client_is_told_and_tries_again(wire):
    async def body(rig, capture, readings):
        rig.inject("qtm", "full")
        with pytest.raises(DeviceErrors) as caught:
            await capture.connect()
        assert "accepts no more clients" in caught.value.lines()[0]
        assert "close another client of QTM" in caught.value.lines()[0]
        rig.boards["qtm"].clear()
        await wire.until(lambda: capture.state is ConnectionState.STREAMING, within=5)

    session(wire, body, connect=False)


def test_several_clients_at_once(wire):
    async def body(rig, capture, readings):
        table = {
            "name": "second",
            "kind": "qualisys",
            "host": "127.0.0.1",
            "port": rig.qtm_servers["qtm"].port,
        }
        second, seen = wire.driver({**table, "bodies": {"tip": "end"}, "divisor": 2})
        await second.connect()
        await wire.more(seen)
        assert set(seen.last.value.poses) == {"end"}
        assert second.health.gaps == 0
        await second.close()
        await wire.more(readings)

    session(wire, body)


def test_discovery_finds_the_host_at_the_given_address(wire):
    async def main():
        async with wire.bench({**FAKE, "discovery_port": 0}) as rig:
            (endpoint,) = rig.endpoints()
            (host,) = await discover("127.0.0.1", endpoint.discovery_port)
            assert host.base_port + 1 == endpoint.port
            assert "QTM 2.3" in host.description

    wire.run(main, SPEED)


def test_a_dead_port_is_named_with_its_cure(wire):
    async def body(rig, capture, readings):
        with pytest.raises(DeviceErrors) as caught:
            await capture.connect()
        assert "127.0.0.1:1 cannot be reached" in caught.value.lines()[0]
        assert "22223 by default" in caught.value.lines()[0]

    session(wire, body, connect=False, port=1)
