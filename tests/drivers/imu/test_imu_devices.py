"""Inertial units as devices: lost samples, restarts, rate, settings."""

import asyncio
import struct
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softarm.drivers.errors import ProtocolError
from softarm.drivers.imu.device import Bno08xConfig, QuaternionLineConfig, XbusConfig
from softarm.drivers.imu.sample import ImuSample
from softarm.drivers.imu.sequence import IndexTracker, RateMonitor
from softarm.drivers.imu.wit_device import WitConfig, WitImu
from softarm.drivers.imu.xbus import encode_message
from softarm.drivers.reading import Reading

MS = 1_000_000
PERIOD = 10 * MS


class Readings(list[Reading[ImuSample]]):
    """A sink that keeps what it gets."""

    def __call__(self, reading: Reading[ImuSample]) -> None:
        self.append(reading)


def rvc(index: int, yaw: int = 0) -> bytes:
    body = struct.pack("<B6h3x", index % 256, yaw, 0, 0, 0, 0, 1000)
    return b"\xaa\xaa" + body + bytes([sum(body) % 256])


def test_lost_samples_are_counted_and_the_sequence_goes_on() -> None:
    readings = Readings()
    device = Bno08xConfig(name="imu", port="/dev/none").build(readings)
    for index in [*range(250, 258), *range(261, 265)]:
        device.receive(rvc(index), index * PERIOD)
    assert device.health.gaps == 3
    assert [reading.sequence for reading in readings] == [*range(8), *range(11, 15)]
    assert len({reading.epoch for reading in readings}) == 1


def test_a_restart_begins_an_epoch() -> None:
    readings = Readings()
    device = Bno08xConfig(name="imu", port="/dev/none").build(readings)
    for index in range(100, 120):
        device.receive(rvc(index, yaw=4500), index * PERIOD)
    for index in range(5):
        device.receive(rvc(index), 119 * PERIOD + 300 * MS + index * PERIOD)
    assert readings[19].epoch + 1 == readings[20].epoch == readings[-1].epoch
    assert [reading.sequence for reading in readings[20:]] == list(range(5))
    assert device.health.events["unit restarted"] == 1
    assert device.health.gaps == 0


def test_a_burst_after_a_stall_is_no_restart() -> None:
    readings = Readings()
    device = Bno08xConfig(name="imu", port="/dev/none").build(readings)
    device.receive(rvc(0), 0)
    device.receive(b"".join(rvc(index) for index in range(1, 60)), 600 * MS)
    assert len({reading.epoch for reading in readings}) == 1
    assert device.health.gaps == 0


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.integers(0, 255), st.lists(st.integers(1, 200), max_size=20))
def test_gaps_that_fit_the_time_are_gaps(start: int, steps: list[int]) -> None:
    tracker = IndexTracker(256, PERIOD)
    tracker.step(start, 0)
    index, lost = start, 0
    for step in steps:
        index += step
        outcome = tracker.step(index % 256, (index - start) * PERIOD)
        assert not outcome.restarted
        lost += outcome.lost
    assert lost == sum(step - 1 for step in steps)


def test_a_damaged_frame_is_counted_and_no_reading() -> None:
    readings = Readings()
    device = Bno08xConfig(name="imu", port="/dev/none").build(readings)
    bad = bytearray(rvc(1))
    bad[5] ^= 1
    for at, frame in enumerate([rvc(0), bytes(bad), rvc(2)]):
        device.receive(frame, at * PERIOD)
    assert [reading.sequence for reading in readings] == [0, 2]
    assert device.health.bad_checksum == 1
    assert device.health.gaps == 1


def test_the_rate_is_measured_and_a_wrong_one_is_an_alarm() -> None:
    device = Bno08xConfig(name="imu", port="/dev/none").build()
    for index in range(150):
        device.receive(rvc(index), index * 2 * PERIOD)
    assert device.rate.rate == pytest.approx(50, rel=0.01)
    assert device.health.alarms.active[0].value == 50.0
    for index in range(150, 600):
        device.receive(rvc(index), 300 * PERIOD + index * PERIOD)
    assert "rate" not in device.health.alarms


def test_rate_monitor_counts_over_its_window() -> None:
    monitor = RateMonitor(100 * MS)
    assert [monitor.sample(t * 25 * MS) for t in range(6)] == [False] * 4 + [True, False]
    assert monitor.rate == pytest.approx(40)


def test_a_pause_is_no_low_rate() -> None:
    monitor = RateMonitor(1000 * MS)
    times = [*range(0, 600, 25), *range(1200, 2300, 25)]
    assert [monitor.sample(t * MS) for t in times].count(True) == 1
    assert monitor.rate == pytest.approx(40)


def xbus(counter: int, ticks: int) -> bytes:
    groups = struct.pack(">HBH", 0x1020, 2, counter) + struct.pack(">HBI", 0x1060, 4, ticks)
    return encode_message(0x36, groups + struct.pack(">HB4f", 0x2010, 16, 1, 0, 0, 0))


def test_xbus_time_maps_wraps_and_restarts() -> None:
    readings = Readings()
    device = XbusConfig(name="imu", port="/dev/none").build(readings)
    top = 2**32
    for n in range(4):
        device.receive(xbus(n, (top - 200 + 100 * n) % top), n * PERIOD + (3 * MS if n == 1 else 0))
    assert [reading.device_time_ns is not None for reading in readings] == [True] * 4
    steps = [b.measured_ns - a.measured_ns for a, b in pairwise(readings)]
    assert steps == [pytest.approx(PERIOD, abs=2)] * 3
    assert len({reading.epoch for reading in readings}) == 1
    device.receive(xbus(0, 50), 100 * PERIOD)
    assert readings[-1].epoch > readings[0].epoch


def test_xbus_errors_and_other_messages_are_counted() -> None:
    readings = Readings()
    device = XbusConfig(name="imu", port="/dev/none").build(readings)
    device.receive(encode_message(0x42, b"\x03") + encode_message(0x3E) + xbus(0, 1), 0)
    assert len(readings) == 1
    assert device.health.rejected == 1
    assert device.health.events["other frames"] == 2
    assert device.health.events["unit restarted"] == 1


def test_a_silent_xbus_unit_is_asked_to_measure(virtual: Any) -> None:
    class Unit:
        def __init__(self) -> None:
            self.sent: list[bytes] = []

        def write(self, data: bytes) -> None:
            self.sent.append(data)

    async def main() -> None:
        unit: Any = Unit()
        device = XbusConfig(name="imu", port="/dev/none").build(clock=virtual.clock)
        running = asyncio.create_task(device.run(unit))
        await asyncio.sleep(0.5)
        device.receive(xbus(0, 1), 0)
        await asyncio.sleep(1.7)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        assert unit.sent == [bytes.fromhex("fa ff 10 00 f1")]

    virtual.run(main)


def test_a_jump_without_a_silence_is_lost_samples() -> None:
    tracker = IndexTracker(256, PERIOD)
    tracker.step(10, 0)
    assert tracker.step(60, PERIOD).lost == 49
    assert not tracker.step(60, 2 * PERIOD).restarted


def test_one_of_two_sensors_on_a_line() -> None:
    readings = Readings()
    device = QuaternionLineConfig(name="imu", port="/dev/none", unit=2).build(readings)
    device.receive(
        b"\nQuaternion of IMU 1:1.00,0.00,0.00,0.00\r\nQuaternion of IMU 2:0.00,1.00,0.00,0.00\r\n", 0
    )
    assert [reading.value.quaternion for reading in readings] == [(0, 1, 0, 0)]


def wit_frame(kind: int) -> bytes:
    body = struct.pack("<BB4h", 0x55, kind, 32767 if kind == 0x59 else 0, 0, 0, 0)
    return body + bytes([sum(body) % 256])


class WitUnit:
    """Sends frames at a rate and takes the commands of the datasheet."""

    def __init__(self, device: WitImu, kinds: set[int], rate: float, *, deaf: bool = False) -> None:
        self.kinds, self.rate, self.deaf = kinds, rate, deaf
        self.commands: list[bytes] = []
        self._device = device
        self._unlocked = False

    def write(self, data: bytes) -> None:
        self.commands.append(data)
        if self.deaf:
            return
        if data == bytes.fromhex("ff aa 69 88 b5"):
            self._unlocked = True
        elif self._unlocked and data[2] == 0x02:
            mask = data[3] | data[4] << 8
            self.kinds = {0x50 + bit for bit in range(11) if mask >> bit & 1}
        elif self._unlocked and data[2] == 0x03:
            self.rate = {6: 10.0, 8: 50.0, 9: 100.0}[data[3]]

    async def send(self) -> None:
        while True:
            await asyncio.sleep(1 / self.rate)
            data = b"".join(wit_frame(kind) for kind in sorted(self.kinds))
            self._device.receive(data, self._device.clock())


def wit(virtual: Any, **options: Any) -> tuple[WitImu, Readings]:
    readings = Readings()
    return WitConfig(name="imu", port="/dev/none", **options).build(readings, virtual.clock), readings


async def with_unit(unit: WitUnit, work: Any) -> None:
    sending = asyncio.create_task(unit.send())
    try:
        await work
    finally:
        sending.cancel()
        await asyncio.gather(sending, return_exceptions=True)


def test_a_wit_unit_as_wanted_is_left_alone(virtual: Any) -> None:
    async def main() -> None:
        device, readings = wit(virtual)
        unit: Any = WitUnit(device, {0x51, 0x59}, 100)
        await with_unit(unit, device.begin(unit))
        assert unit.commands == []
        assert len(readings) > 50

    virtual.run(main)


def test_a_wit_unit_with_other_content_and_rate_is_set(virtual: Any) -> None:
    async def main() -> None:
        device, readings = wit(virtual)
        unit: Any = WitUnit(device, {0x51, 0x52, 0x53, 0x54}, 10)
        await with_unit(unit, device.begin(unit))
        assert unit.kinds == {0x51, 0x59}
        assert unit.rate == 100
        assert readings
        assert device.health.events["configured"] == 1
        assert not any(command == bytes.fromhex("ff aa 00 00 00") for command in unit.commands)

    virtual.run(main)


@pytest.mark.parametrize(("deaf", "configure", "commands"), [(True, True, 3), (False, False, 0)])
def test_a_wit_unit_that_stays_wrong_is_told(
    virtual: Any, deaf: bool, configure: bool, commands: int
) -> None:
    async def main() -> None:
        device, _ = wit(virtual, configure=configure)
        unit: Any = WitUnit(device, {0x51, 0x53}, 10, deaf=deaf)
        with pytest.raises(ProtocolError, match=r"sends 0x51 at \d+ Hz, 0x53 at \d+ Hz; set the unit to"):
            await with_unit(unit, device.begin(unit))
        assert len(unit.commands) == commands

    virtual.run(main)


def test_a_wit_unit_that_forgets_is_set_again_while_it_runs(virtual: Any) -> None:
    async def main() -> None:
        device, _ = wit(virtual)
        unit: Any = WitUnit(device, {0x51, 0x53}, 10)
        running = asyncio.create_task(device.run(unit))
        await with_unit(unit, asyncio.sleep(5))
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        assert unit.kinds == {0x51, 0x59}
        assert unit.rate == 100

    virtual.run(main)


def test_a_line_too_slow_for_the_content_is_refused() -> None:
    with pytest.raises(ValueError, match=r"22 kbit/s do not fit 9600 baud"):
        WitConfig(name="imu", port="/dev/none", baud=9600)
    with pytest.raises(ValueError, match="rate_hz 30 is not one of"):
        WitConfig(name="imu", port="/dev/none", rate_hz=30)
