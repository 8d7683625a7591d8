"""Force gauges as devices: units, direction, tare, and what an operator does to them."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from softarm.drivers.errors import ConnectionLost, ProtocolError
from softarm.drivers.gauges.device import LineGaugeConfig, LutronConfig, StreamingGauge
from softarm.drivers.gauges.force import ForceScale, GaugeForce
from softarm.drivers.gauges.polled import Mark10Config, Mark10Gauge, PolledGauge, SauterConfig, SauterGauge
from softarm.drivers.gauges.sample import GaugeSample
from softarm.drivers.reading import Reading

MS = 1_000_000


class Readings(list[Reading[GaugeForce]]):
    """A sink that keeps what it gets."""

    def __call__(self, reading: Reading[GaugeForce]) -> None:
        self.append(reading)


def lutron(value: int, unit: bytes = b"57", decimals: int = 0, negative: bool = False) -> bytes:
    return b"\x0241" + unit + b"%d%d%08d\r" % (negative, decimals, value)


def gauge(**options: Any) -> tuple[StreamingGauge, Readings]:
    readings = Readings()
    config = LutronConfig(name="gauge", port="/dev/none", **options)
    return config.build(readings), readings


def test_a_lutron_frame_is_a_pull_in_newton_measured_before_it_arrived() -> None:
    device, readings = gauge()
    device.receive(lutron(1234), 100 * MS)
    (reading,) = readings
    assert reading.value.force == pytest.approx(12.101406)
    assert reading.value.resolution == pytest.approx(9.80665e-3)
    assert reading.valid
    assert reading.measured_ns == 83 * MS
    assert reading.source == "serial:///dev/none?baud=9600"


def test_a_simulated_gauge_says_so() -> None:
    device, _ = gauge(simulated=True)
    assert device.source.startswith("fake+serial://")


def test_direction_can_be_turned() -> None:
    device, readings = gauge(pull_sign=-1)
    device.receive(lutron(100), 0)
    assert readings[0].value.force < 0


def test_unit_and_decimals_changed_by_the_operator_are_events_and_the_force_stays() -> None:
    device, readings = gauge()
    device.receive(lutron(1000), 0)
    device.receive(lutron(1000, b"55", 3), MS)
    device.receive(lutron(10000, b"55", 3), 2 * MS)
    device.receive(lutron(1000, b"55", 2), 3 * MS)
    forces = [reading.value.force for reading in readings]
    assert forces[:2] == [pytest.approx(9.80665)] * 2
    assert forces[3] == pytest.approx(forces[2])
    assert [reading.flags for reading in readings] == [(), ("unit_changed",), (), ("decimals_changed",)]
    assert all(reading.valid for reading in readings)
    assert device.health.events["unit_changed"] == device.health.events["decimals_changed"] == 1


def test_over_range_is_invalid_flagged_and_an_alarm_until_it_ends() -> None:
    device, readings = gauge()
    device.receive(lutron(99999999), 0)
    assert not readings[0].valid
    assert readings[0].flags == ("over_range",)
    assert "over_range" in device.health.alarms
    device.receive(lutron(10), 0)
    assert readings[1].valid
    assert "over_range" not in device.health.alarms
    assert device.health.events["over_range"] == 1


def test_zero_pressed_by_the_operator_is_an_event() -> None:
    device, readings = gauge()
    for grams in (500, 501, 1, 0):
        device.receive(lutron(grams), 0)
    assert [reading.flags for reading in readings] == [(), (), ("step_to_zero",), ()]
    assert device.health.events["step_to_zero"] == 1


def test_other_displays_and_faults_are_counted_and_never_read() -> None:
    device, readings = gauge()
    device.receive(lutron(1), 0)
    device.receive(b"\x02425700" + b"00000077\r", 0)
    device.receive(b"noise", 0)
    device.receive(b"\x0241B20200000052\r", 0)
    device.receive(lutron(2), 0)
    assert [round(reading.value.gross / 9.80665e-3) for reading in readings] == [1, 2]
    assert device.health.rejected == 2
    assert device.health.resyncs == 1


def test_a_board_that_does_not_tell_its_unit_is_not_believed() -> None:
    readings = Readings()
    silent = LineGaugeConfig(name="gauge", port="/dev/none").build(readings)
    silent.receive(b"\n12.5\n", 0)
    assert not readings[0].valid
    assert readings[0].flags == ("unit_unknown",)
    assert "unit" in silent.health.alarms
    told = LineGaugeConfig(name="gauge", port="/dev/none", unit="g").build(readings)
    told.receive(b"\n12.5\n", 0)
    assert readings[1].value.force == pytest.approx(12.5 * 9.80665e-3)


def test_a_unit_sent_wins_over_the_one_configured() -> None:
    judged = ForceScale(1, "kg").judge(GaugeSample(2.0, "N", 1))
    assert judged.force.force == 2.0


class ScriptedLink:
    """Stands in for the serial link: answers each question as scripted."""

    def __init__(self, device: PolledGauge[Any], answers: Callable[[bytes], list[bytes]]) -> None:
        self.asked: list[bytes] = []
        self._device = device
        self._answers = answers

    def flush(self) -> None:
        pass

    def write(self, data: bytes) -> None:
        self.asked.append(data)
        loop = asyncio.get_running_loop()
        for portion in self._answers(data):
            loop.call_soon(self._device.receive, portion, self._device.clock())


Run = Callable[[Callable[[], Awaitable[Any]]], Any]


def mark10(settings: bytes, reading: bytes) -> Callable[[bytes], list[bytes]]:
    return lambda question: [settings if question == b"LIST\r\n" else reading]


GOOD = b"V1.00;LBF;CUR;FLTC8;FLTP1;AOUT00;AOFF5;FULL;MIT;POL;B0\r\n"


def build_mark10(virtual: Any) -> tuple[Mark10Gauge, Readings]:
    readings = Readings()
    config = Mark10Config(name="gauge", port="/dev/none")
    return config.build(readings, virtual.clock), readings


def test_mark10_tension_is_a_pull(virtual: Any) -> None:
    async def main() -> None:
        device, readings = build_mark10(virtual)
        link: Any = ScriptedLink(device, mark10(GOOD, b"-18.78 lbF\r\n"))
        await device.begin(link)
        (reading,) = readings
        assert reading.valid
        assert reading.value.force == pytest.approx(18.78 * 4.4482216152605)
        assert link.asked == [b"LIST\r\n", b"?\r\n"]
        assert device.health.round_trip.count == 2

    virtual.run(main)


@pytest.mark.parametrize("word", [b"INV", b"NOPOL"])
def test_mark10_with_another_polarity_is_not_trusted(virtual: Any, word: bytes) -> None:
    async def main() -> None:
        device, readings = build_mark10(virtual)
        link: Any = ScriptedLink(device, mark10(GOOD.replace(b"POL", word), b"18.78 lbF\r\n"))
        await device.begin(link)
        assert not readings[0].valid
        assert readings[0].flags == ("settings",)
        assert "polarity" in device.health.alarms

    virtual.run(main)


@pytest.mark.parametrize("mode", [b"PT", b"PC"])
def test_mark10_peaks_are_no_force(virtual: Any, mode: bytes) -> None:
    async def main() -> None:
        device, readings = build_mark10(virtual)
        settings = [GOOD.replace(b"CUR", mode)]
        link: Any = ScriptedLink(device, lambda q: [settings[0] if q == b"LIST\r\n" else b"-30.0 lbF\r\n"])
        await device.begin(link)
        assert not readings[0].valid
        assert readings[0].flags == ("settings",)
        assert "peak" in device.health.alarms
        settings[0] = GOOD
        await device.begin(link)
        assert readings[-1].valid
        assert "peak" not in device.health.alarms

    virtual.run(main)


def test_mark10_that_refuses_its_settings_is_named_as_such(virtual: Any) -> None:
    async def main() -> None:
        device, _ = build_mark10(virtual)
        link: Any = ScriptedLink(device, mark10(b"*10\r\n", b"1.0 N\r\n"))
        with pytest.raises(ProtocolError, match=r"answers \*10, illegal command, to LIST; use a gauge"):
            await device.begin(link)

    virtual.run(main)


def test_mark10_settings_are_read_again_and_the_alarm_ends(virtual: Any) -> None:
    async def main() -> None:
        device, readings = build_mark10(virtual)
        settings = [GOOD.replace(b"POL", b"INV")]
        link: Any = ScriptedLink(device, lambda q: [settings[0] if q == b"LIST\r\n" else b"1.0 N\r\n"])
        await device.begin(link)
        settings[0] = GOOD
        running = asyncio.create_task(device.run(link))
        await asyncio.sleep(6)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        assert readings[-1].valid
        assert "polarity" not in device.health.alarms
        assert 6 <= link.asked.count(b"LIST\r\n") <= 8
        assert 95 <= len(readings) <= 122

    virtual.run(main)


def test_mark10_a_load_that_turns_over_is_trusted_only_after_the_settings_were_read(virtual: Any) -> None:
    async def main() -> None:
        device, readings = build_mark10(virtual)
        settings, value = [GOOD], [b"-1.00 N\r\n"]
        link: Any = ScriptedLink(device, lambda q: [settings[0] if q == b"LIST\r\n" else value[0]])
        await device.begin(link)
        value[0] = b"1.00 N\r\n"
        await device.poll(link)
        await device.poll(link)
        assert [reading.valid for reading in readings] == [True, False, True]
        assert readings[1].flags == ("settings",)
        settings[0], value[0] = GOOD.replace(b"POL", b"INV"), b"-1.00 N\r\n"
        await device.poll(link)
        await device.poll(link)
        assert not readings[-1].valid
        assert not readings[-2].valid

    virtual.run(main)


def test_mark10_without_a_unit_takes_that_of_its_settings(virtual: Any) -> None:
    async def main() -> None:
        device, readings = build_mark10(virtual)
        link: Any = ScriptedLink(device, mark10(GOOD.replace(b"FULL", b"NUM"), b"-2.00\r\n"))
        await device.begin(link)
        assert readings[0].value.force == pytest.approx(2 * 4.4482216152605)

    virtual.run(main)


def test_mark10_errors_silence_and_overload(virtual: Any) -> None:
    async def main() -> None:
        device, readings = build_mark10(virtual)
        answers = [[GOOD], [b"*10\r\n"], [], [b"---- lbF\r\n"], [b"junk\r\n"], [b"1.0 N\r\n"]]
        link: Any = ScriptedLink(device, lambda _: answers.pop(0))
        await device.begin(link)
        await device.poll(link)
        await device.poll(link)
        assert [reading.valid for reading in readings] == [False, True]
        assert readings[0].flags == ("over_range",)
        assert device.health.rejected == 1
        assert device.health.timeouts == 2
        assert device.health.malformed == 1

    virtual.run(main)


def test_sauter_asks_again_after_a_torn_answer(virtual: Any) -> None:
    async def main() -> None:
        readings = Readings()
        device = SauterConfig(name="gauge", port="/dev/none", unit="N").build(readings, virtual.clock)
        assert isinstance(device, SauterGauge)
        answers = [[b"011.70"], [b"0011", b".70"], [b"1021.15extra"], [], [b"1021.15"]]
        link: Any = ScriptedLink(device, lambda _: answers.pop(0))
        await device.begin(link)
        assert [reading.value.force for reading in readings] == [pytest.approx(-11.70)]
        assert [await device.poll(link) for _ in range(3)] == [False, False, True]
        assert readings[-1].value.force == pytest.approx(21.15)
        assert device.health.malformed == 2
        assert device.health.timeouts == 3
        assert link.asked == [b"9"] * 5

    virtual.run(main)


def test_a_lost_link_ends_the_polling(virtual: Any) -> None:
    class Gone:
        def flush(self) -> None:
            pass

        def write(self, data: bytes) -> None:
            raise ConnectionLost("gauge", "takes no commands", "check cable and power")

    async def main() -> None:
        device, _ = build_mark10(virtual)
        link: Any = Gone()
        with pytest.raises(ConnectionLost):
            await device.begin(link)

    virtual.run(main)


def test_sauter_must_be_told_its_unit() -> None:
    with pytest.raises(ValueError, match="unit"):
        SauterConfig(name="gauge", port="/dev/none")  # type: ignore[call-arg]
