"""The valve driver against the fake terminal on a real port, with every fault of the matrix."""

import asyncio
import contextlib
from itertools import pairwise

import pytest

from softarm.drivers.errors import DeviceErrors, InterlockError
from softarm.drivers.supervisor import ConnectionState

FAKE = {"name": "valves", "kind": "festo_mpa", "valve_map": [3, 2, 1, 0, 4, 5]}
DRIVER = {
    "name": "valves",
    "kind": "festo_mpa",
    "host": "127.0.0.1",
    "chambers": [3, 2, 1, 0, 4, 5],
    "maximum_pa": 50e3,
}
SIX = [30e3, 0.0, 10e3, 0.0, 5e3, 0.0]


def session(wire, body, *, connect=True, fake=None, **driver):
    """Run ``body(rig, bank, readings)`` with the bank connected; afterwards every outlet must vent."""

    async def main():
        async with wire.bench({**FAKE, **(fake or {})}) as rig:
            port = rig.valve_ports["valves"]
            bank, readings = wire.driver(
                {**DRIVER, "kind": (fake or FAKE).get("kind", "festo_mpa"), "port": port.port, **driver}
            )
            if connect:
                await bank.connect()
                await wire.until(lambda: readings.all, what="first reading")
            try:
                await body(rig, bank, readings)
            finally:
                await bank.close()
            rig.boards["valves"].clear()
            node = port.node
            await wire.until(lambda: max(node.pressures()) < 200.0, what="vented")

    wire.run(main)


@contextlib.asynccontextmanager
async def holding(bank, setpoint=SIX, lifetime_s=0.3):
    """Renew a set-point as a control loop would; what the bank refuses ends it."""

    async def renew():
        with contextlib.suppress(InterlockError):
            while True:
                bank.command(setpoint, lifetime_s)
                await asyncio.sleep(0.02)

    task = asyncio.create_task(renew())
    try:
        yield task
    finally:
        task.cancel()
        await asyncio.wait({task})


@contextlib.asynccontextmanager
async def inflated(wire, rig, bank):
    """Arm, hold, and wait until chamber 0 (valve 3) has its pressure."""
    bank.arm()
    async with holding(bank) as task:
        await wire.until(lambda: outlets(rig)[3] > 27e3, what="inflated")
        yield task


def outlets(rig):
    return rig.valve_ports["valves"].node.pressures()


async def inflate(wire, rig, bank):
    """Arm and wait until chamber 0 has its pressure."""
    async with inflated(wire, rig, bank):
        pass


def test_pressures_arrive_in_the_mapped_valves_and_are_read_back(wire):
    async def body(rig, bank, readings):
        bank.arm()
        async with holding(bank):
            await wire.until(lambda: outlets(rig)[3] > 29e3)
            await wire.until(lambda: readings.last.value.echo == tuple(SIX))
            await wire.until(lambda: abs(readings.last.value.readback[0] - 30e3) < 1.5e3)
        assert outlets(rig)[1] == pytest.approx(10e3, abs=1e3)
        assert outlets(rig)[0] == outlets(rig)[2] == 0.0
        assert readings.last.source == f"fake+modbus+tcp://127.0.0.1:{rig.valve_ports['valves'].port}"
        await wire.until(lambda: rig.state.chamber_pressures[0] > 29e3)

    session(wire, body)


def test_closing_vents_and_has_nothing_to_complain_of(wire, caplog):
    async def body(rig, bank, readings):
        await inflate(wire, rig, bank)

    session(wire, body)
    assert not caplog.records


def test_the_terminal_vents_when_its_master_falls_silent(wire):
    async def body(rig, bank, readings):
        await asyncio.sleep(0)
        async with inflated(wire, rig, bank):
            rig.inject("valves", "freeze")
            began = rig.clock.now()
            await wire.until(lambda: rig.valve_ports["valves"].node.watchdog_trips == 1)
            assert rig.clock.now() - began == pytest.approx(0.18, abs=0.06)
            await wire.until(lambda: outlets(rig).max() < 200.0)
            assert await bank.supervisor.wait_for(ConnectionState.FAULT) is ConnectionState.FAULT
            rig.boards["valves"].clear()
            await bank.supervisor.wait_for(ConnectionState.STREAMING)
            with pytest.raises(InterlockError):
                bank.command(SIX, 0.2)
            assert outlets(rig).max() < 200.0

    session(wire, body)


def test_a_node_that_goes_down_is_found_again_and_stays_vented(wire):
    async def body(rig, bank, readings):
        async with inflated(wire, rig, bank):
            rig.inject("valves", "node_down")
            await bank.supervisor.wait_for(ConnectionState.FAULT)
            epoch = readings.last.epoch
            rig.boards["valves"].clear()
            await wire.until(lambda: bank.state is ConnectionState.STREAMING, 10.0)
            await wire.until(lambda: readings.last.epoch > epoch)
            assert readings.last.value.applied == (0.0,) * 6
            assert not readings.last.value.armed
            assert bank.health.reconnects == 1

    session(wire, body)


def test_after_a_reconnection_pressure_starts_from_zero_at_the_slew_limit(wire):
    async def body(rig, bank, readings):
        await inflate(wire, rig, bank)
        rig.inject("valves", "freeze")
        await bank.supervisor.wait_for(ConnectionState.FAULT)
        await wire.until(lambda: outlets(rig).max() < 200.0)
        rig.boards["valves"].clear()
        await bank.supervisor.wait_for(ConnectionState.STREAMING)
        count = len(readings.all)
        bank.arm()
        async with holding(bank):
            await wire.until(lambda: len(readings.all) > count)
            echoes = [0.0]
            while echoes[-1] < 30e3:
                await wire.until(lambda: readings.last.value.echo[0] != echoes[-1], what="the next echo")
                echoes.append(readings.last.value.echo[0])
        assert max(after - before for before, after in pairwise(echoes)) <= 6e3
        assert len(echoes) > 10

    session(wire, body, slew_pa_per_s=100e3)


def test_refused_connections_are_retried_with_growing_waits(wire):
    async def body(rig, bank, readings):
        rig.inject("valves", "node_down")
        with pytest.raises(DeviceErrors, match="valves"):
            await bank.connect()
        assert bank.state is ConnectionState.FAULT
        await wire.until(lambda: bank.health.failures >= 3, 10.0)
        rig.boards["valves"].clear()
        await wire.until(lambda: bank.state is ConnectionState.STREAMING, 10.0)

    session(wire, body, connect=False)


def test_outputs_cleared_by_the_terminal_are_not_resumed(wire):
    async def body(rig, bank, readings):
        async with inflated(wire, rig, bank) as task:
            rig.inject("valves", "watchdog_fired")
            await wire.until(task.done)
            await wire.until(lambda: bank.health.events["the terminal cleared its outputs"] == 1)
            await wire.until(lambda: outlets(rig).max() < 200.0)
        with pytest.raises(InterlockError):
            bank.command(SIX, 0.2)

    session(wire, body)


def test_a_second_master_is_noticed(wire):
    async def body(rig, bank, readings):
        async with inflated(wire, rig, bank) as task:
            rig.inject("valves", "second_master", {"channel": 9, "mbar": 250})
            await wire.until(task.done)
            await wire.until(lambda: bank.health.events["another master wrote to the valves"] == 1)
            await wire.until(lambda: outlets(rig).max() < 200.0)

    session(wire, body)


@pytest.mark.parametrize("served", [True, False])
def test_a_reset_after_a_request_ends_the_session_at_once(wire, served):
    async def body(rig, bank, readings):
        async with inflated(wire, rig, bank):
            began = rig.clock.now()
            rig.inject("valves", "drop_after_request", {"served": served})
            await bank.supervisor.wait_for(ConnectionState.FAULT)
            assert rig.clock.now() - began < 0.1
            await wire.until(lambda: bank.state is ConnectionState.STREAMING, 10.0)
            await wire.until(lambda: outlets(rig).max() < 200.0)
            assert readings.last.value.applied == (0.0,) * 6

    session(wire, body)


def test_a_late_answer_is_discarded_by_its_transaction(wire):
    async def body(rig, bank, readings):
        async with inflated(wire, rig, bank):
            rig.inject("valves", "late_reply", {"delay_s": 0.13})
            await wire.until(lambda: bank.health.timeouts == 1)
            count = len(readings.all)
            await wire.until(lambda: len(readings.all) > count + 30)
            assert bank.health.reconnects == 0
            assert bank.health.failures == 0
            assert outlets(rig)[3] > 27e3
        assert wire.counts(rig, "valves")["late_reply"] == 1

    session(wire, body)


def test_a_busy_node_is_asked_again(wire):
    async def body(rig, bank, readings):
        rig.inject("valves", "exception", {"code": 6}, times=5)
        await wire.until(lambda: bank.health.events["terminal busy"] == 5)
        count = len(readings.all)
        await wire.until(lambda: len(readings.all) > count + 5)
        assert bank.state is ConnectionState.STREAMING
        assert bank.health.failures == 0

    session(wire, body)


@pytest.mark.parametrize("code", [1, 2, 3, 4])
def test_another_exception_is_an_error_of_the_configuration(wire, code):
    async def body(rig, bank, readings):
        rig.inject("valves", "exception", {"code": code})
        await bank.supervisor.wait_for(ConnectionState.FAULT)
        await wire.until(lambda: not bank.supervisor.retrying)
        assert f"exception {code}" in str(bank.health.last_error)

    session(wire, body)


@pytest.mark.parametrize(
    "fault", ["short_reply", "wrong_function", "wrong_transaction", "wrong_protocol", "garbage"]
)
def test_an_answer_that_does_not_fit_never_becomes_a_reading(wire, fault):
    async def body(rig, bank, readings):
        await wire.until(lambda: len(readings.all) > 10)
        rig.inject("valves", fault)
        await wire.until(lambda: wire.counts(rig, "valves")[fault] == 1)
        count = len(readings.all)
        await wire.until(lambda: len(readings.all) > count + 20, 10.0)
        assert all(max(map(abs, reading.value.readback)) < 500.0 for reading in readings.all)
        health = bank.health
        assert health.timeouts + health.rejected + health.failures + health.malformed >= 1

    session(wire, body)


def test_answers_in_two_segments_are_whole(wire):
    async def body(rig, bank, readings):
        rig.inject("valves", "split_reply")
        count = len(readings.all)
        await wire.until(lambda: len(readings.all) > count + 30)
        assert bank.health.timeouts == bank.health.rejected == bank.health.failures == 0

    session(wire, body)


def test_below_zero_is_read_with_its_sign(wire):
    async def body(rig, bank, readings):
        rig.inject("valves", "reading_offset", {"channel": 3, "mbar": -7})
        await wire.until(lambda: readings.last.value.readback[0] < -300.0)
        assert readings.last.value.readback[0] == pytest.approx(-700.0, abs=100.0)

    session(wire, body)


def test_a_faulty_valve_is_named_by_its_chamber(wire):
    async def body(rig, bank, readings):
        async with inflated(wire, rig, bank):
            rig.inject("valves", "valve_fault", {"channel": 3, "code": 31})
            await wire.until(lambda: readings.last.value.diagnosis[0] == 31)
            await wire.until(lambda: any("chamber 0" in str(a) for a in bank.health.alarms.active))

    session(wire, body)


def test_a_full_node_is_asked_again_later(wire):
    async def body(rig, bank, readings):
        rig.inject("valves", "refuse")
        with pytest.raises(DeviceErrors):
            await bank.connect()
        rig.boards["valves"].clear()
        await wire.until(lambda: bank.state is ConnectionState.STREAMING, 10.0)

    session(wire, body, connect=False)


def test_slow_answers_only_cost_time(wire):
    async def body(rig, bank, readings):
        rig.inject("valves", "delay", {"delay_s": 0.03})
        count = len(readings.all)
        await wire.until(lambda: len(readings.all) > count + 10)
        assert bank.health.failures == bank.health.timeouts == 0
        assert bank.health.overruns > 0

    session(wire, body)


def test_missing_supply_shows_in_diagnosis_and_tracking(wire):
    async def body(rig, bank, readings):
        async with inflated(wire, rig, bank):
            rig.inject("valves", "supply_missing", {"mbar": 20.0})
            await wire.until(lambda: all(readings.last.value.diagnosis))
            await wire.until(lambda: readings.last.value.readback[0] < 3e3)
            names = lambda: " ".join(str(alarm) for alarm in bank.health.alarms.active)  # noqa: E731
            await wire.until(lambda: "chamber 0" in names())

    session(wire, body)


def test_a_stuck_valve_is_a_tracking_fault(wire):
    async def body(rig, bank, readings):
        bank.arm()
        async with holding(bank):
            rig.inject("valves", "stuck_valve", {"channel": 1})
            await wire.until(lambda: any("chamber 2" in str(a) for a in bank.health.alarms.active), 5.0)

    session(wire, body)


def test_a_terminal_without_watchdog_register_is_used_and_told(wire):
    async def body(rig, bank, readings):
        rig.inject("valves", "no_watchdog")
        await bank.connect()
        await inflate(wire, rig, bank)
        assert "watchdog" in bank.health.facts

    session(wire, body, connect=False)


def test_observing_writes_nothing(wire):
    async def main():
        async with wire.bench({**FAKE}) as rig:
            port = rig.valve_ports["valves"]
            words = []
            port.node.write = lambda address, values: words.append((address, list(values)))
            bank, readings = wire.driver({**DRIVER, "port": port.port}, observe=True)
            await bank.connect()
            await wire.until(lambda: len(readings.all) > 5)
            await bank.close()
            assert words == []

    wire.run(main)


def test_vtem_slots_are_activated_hold_pressure_and_are_put_away(wire):
    fake = {"kind": "festo_vtem", "valve_map": [3, 2, 1, 0, 4, 5]}

    async def body(rig, bank, readings):
        bank.arm()
        async with holding(bank):
            await wire.until(lambda: outlets(rig)[3] > 29e3)
            await wire.until(lambda: abs(readings.last.value.readback[0] - 30e3) < 1.5e3)
        assert outlets(rig)[1] == pytest.approx(10e3, abs=1e3)

    session(wire, body, fake=fake)
