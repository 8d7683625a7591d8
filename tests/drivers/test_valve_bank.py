"""The valve bank's promises, in virtual time against a terminal in memory."""

import asyncio
import contextlib
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softarm.drivers.errors import ConfigurationError, DeviceErrors, InterlockError, LimitError, ProtocolError
from softarm.drivers.supervisor import ConnectionState
from tests.drivers.valve_rig import MemoryTerminal, build

SIX = [30_000.0, 0.0, 10_000.0, 0.0, 5_000.0, 0.0]
PERIOD_S = 0.01


def session(virtual, body, *, terminal=None, **options):
    """Run ``body(bank, terminal, readings)`` on a connected bank and close it."""
    readings = []

    async def main():
        held = terminal(virtual.clock) if terminal else MemoryTerminal(virtual.clock)
        bank = build(virtual, held, readings.append, **options)
        await bank.connect()
        try:
            await body(bank, held, readings)
        finally:
            await bank.close()
        assert held.setpoints == [0] * 16 or options.get("observe")
        assert all(link.closed == 1 for link in held.links)

    virtual.run(main)
    return readings


async def hold(bank, setpoint, seconds, lifetime_s=0.2):
    """Renew a set-point as a control loop would."""
    for _ in range(round(seconds / 0.02)):
        bank.command(setpoint, lifetime_s)
        await asyncio.sleep(0.02)


def test_pressures_reach_the_mapped_valves(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, SIX, 0.6)
        assert readings[-1].value.applied == tuple(SIX)
        assert terminal.setpoints[:6] == [0, 100, 0, 300, 50, 0]
        await asyncio.sleep(0.1)
        assert readings[-1].value.readback == pytest.approx(SIX, abs=300)
        assert readings[-1].value.echo == tuple(SIX)
        assert readings[-1].valid
        assert readings[-1].source == "modbus+tcp://192.0.2.1:502"

    session(virtual, body)


def test_one_block_per_pass_at_the_stated_rate(virtual):
    async def body(bank, terminal, readings):
        began = len(terminal.writes())
        await asyncio.sleep(1.0)
        assert len(terminal.writes()) - began == pytest.approx(100, abs=2)
        assert all(len(words) == 16 for _, words in terminal.writes())
        assert bank.health.overruns == 0

    session(virtual, body)


def test_slew_is_reported_and_keeps_its_rate(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, [40_000.0] + [0.0] * 5, 0.02)
        assert 0.0 < readings[-1].value.applied[0] < readings[-1].value.setpoint[0] == 40_000.0
        await hold(bank, [40_000.0] + [0.0] * 5, 0.4)
        steps = terminal.writes()
        for (before_s, before), (after_s, after) in pairwise(steps):
            allowed = 2000.0 * max(after_s - before_s, PERIOD_S) + 1.0
            assert abs(after[3] - before[3]) <= allowed

    session(virtual, body)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -0.1, 50_000.1])
def test_out_of_range_is_refused_with_value_and_limit_and_nothing_changes(virtual, bad):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, SIX, 0.6)
        with pytest.raises(LimitError, match="chamber 2") as caught:
            bank.command([0.0, 0.0, bad, 0.0, 0.0, 0.0], 0.2)
        assert (caught.value.limit, caught.value.unit) == (50_000.0, "Pa")
        assert terminal.setpoints[:6] == [0, 100, 0, 300, 50, 0]
        with pytest.raises(LimitError, match="lifetime"):
            bank.command(SIX, 1.5)
        with pytest.raises(LimitError, match="6 pressures"):
            bank.command([0.0] * 5, 0.1)

    session(virtual, body)


def test_nothing_moves_before_arm(virtual):
    async def body(bank, terminal, readings):
        with pytest.raises(InterlockError, match="not armed yet"):
            bank.command(SIX, 0.2)
        await asyncio.sleep(0.2)
        assert not any(any(words) for _, words in terminal.writes())

    session(virtual, body)


def test_a_setpoint_that_is_not_renewed_vents(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, SIX, 0.4, lifetime_s=0.3)
        renewed_ns = virtual.clock() - 20_000_000
        await asyncio.sleep(0.5)
        zeros = [time for time, words in terminal.writes() if not any(words) and time > renewed_ns / 1e9]
        assert zeros[0] - renewed_ns / 1e9 == pytest.approx(0.3, abs=0.012)
        assert "set-point expired" in bank.health.alarms
        assert readings[-1].value.setpoint is None
        await hold(bank, SIX, 0.02)
        assert "set-point expired" not in bank.health.alarms

    session(virtual, body)


def test_vent_is_immediate_and_disarms(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, SIX, 0.6)
        bank.vent("the operator asked")
        await asyncio.sleep(2 * PERIOD_S)
        assert terminal.setpoints == [0] * 16
        with pytest.raises(InterlockError, match="the operator asked"):
            bank.command(SIX, 0.2)

    session(virtual, body)


@pytest.mark.parametrize("functions", [(3, 6, 16), (3, 6, 16, 23)])
def test_a_cleared_terminal_is_noticed_and_not_refilled(virtual, functions):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, SIX, 0.6)
        terminal.clear_outputs()
        terminal.log.clear()
        await hold_until_disarmed(bank)
        assert "watchdog fired" in bank.health.alarms
        await asyncio.sleep(0.5)
        assert terminal.setpoints == [0] * 16
        with pytest.raises(InterlockError, match="the terminal cleared its outputs"):
            bank.arm()
        await asyncio.sleep(1.0)
        bank.arm()
        await hold(bank, SIX, 0.02)
        assert any(terminal.setpoints)

    session(virtual, body, terminal=lambda clock: MemoryTerminal(clock, functions=functions))


async def hold_until_disarmed(bank, seconds=2.0):
    for _ in range(round(seconds / 0.005)):
        if not bank.armed:
            return
        bank.command(SIX, 0.2)
        await asyncio.sleep(0.005)
    raise AssertionError("still armed")


def test_a_host_that_stalled_does_not_resume(virtual):
    """The terminal's watchdog fires while the host is busy: the next pass reads first and finds zeros."""

    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, SIX, 0.6)
        bank.command(SIX, 1.0)
        virtual.stall(0.4)
        terminal.log.clear()
        await asyncio.sleep(0.05)
        assert not bank.armed
        assert bank.health.events["the terminal cleared its outputs"] == 1
        assert not any(any(words) for _, words in terminal.writes())

    session(virtual, body, verify_every=1000)


@pytest.mark.parametrize("verify_every", [1, 1000])
def test_a_host_that_stalled_with_an_answer_on_its_way_does_not_resume(virtual, verify_every):
    """The answer was given before the watchdog fired: it is no sign that the terminal was heard since."""

    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, SIX, 0.6)
        bank.command(SIX, 1.0)
        terminal.faults = [lambda: (virtual.stall(0.4), terminal.log.clear())]
        await asyncio.sleep(0.45)
        assert not bank.armed
        assert bank.health.events["the terminal cleared its outputs"] == 1
        assert not any(any(words) for _, words in terminal.writes())

    session(virtual, body, verify_every=verify_every)


def test_an_unanswered_write_is_found_out_before_the_next(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, SIX, 0.6)
        bank.command(SIX, 1.0)
        terminal.faults = ["unheard"]
        await asyncio.sleep(0.02)
        terminal.clear_outputs()
        await asyncio.sleep(0.2)
        assert not bank.armed

    session(virtual, body, verify_every=1000)


def test_a_second_master_is_told_apart_and_vented(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, SIX, 0.6)
        for _ in range(100):
            terminal.setpoints[9] = 123
            if not bank.armed:
                break
            bank.command(SIX, 0.2)
            await asyncio.sleep(0.003)
        assert "foreign writer" in bank.health.alarms
        assert bank.state is ConnectionState.DEGRADED
        assert {reading.flags for reading in readings if not reading.valid} == {("foreign",)}
        await asyncio.sleep(0.1)
        assert terminal.setpoints == [0] * 16

    session(virtual, body)


def test_a_late_echo_is_no_foreign_writer(virtual):
    class Late(MemoryTerminal):
        """Echoes what was written 40 ms ago, as a terminal with a slow cycle does."""

        def read(self, address, count):
            words = super().read(address, count)
            if address == 45395 and count == 48:
                due_ns = self.clock() - 40_000_000
                blocks = [block for time, where, block in self.log if where == 40003 and time <= due_ns]
                words[1::3] = blocks[-1] if blocks else [0] * 16
            return words

    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, SIX, 1.0)
        assert bank.armed
        assert not bank.health.alarms

    session(virtual, body, terminal=Late)


def test_setpoints_left_by_an_earlier_host_are_vented_and_told(virtual):
    def left_over(clock):
        terminal = MemoryTerminal(clock)
        terminal.setpoints[7] = 250
        return terminal

    async def body(bank, terminal, readings):
        assert bank.health.facts["set-points found"] == "valve 7: 250"
        assert terminal.setpoints == [0] * 16
        await asyncio.sleep(0.5)
        assert "foreign writer" not in bank.health.alarms

    session(virtual, body, terminal=left_over)


def test_coming_back_brings_readings_and_no_motion(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, SIX, 0.6)
        epoch = readings[-1].epoch
        terminal.down = True
        await bank.supervisor.wait_for(ConnectionState.FAULT)
        assert not bank.armed
        terminal.down = False
        terminal.log.clear()
        await bank.supervisor.wait_for(ConnectionState.STREAMING)
        await asyncio.sleep(0.5)
        assert readings[-1].epoch == epoch + 1
        assert not any(any(words) for _, words in terminal.writes())
        with pytest.raises(InterlockError, match="the connection was lost"):
            bank.command(SIX, 0.2)
        assert bank.health.reconnects == 1

    session(virtual, body)


def test_an_unanswered_write_is_read_back_before_the_next(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, SIX, 0.6)
        for fault in ("unanswered", "unheard"):
            terminal.faults = [fault]
            bank.command(SIX, 1.0)
            await asyncio.sleep(0.02)
            assert not terminal.faults
            writes = len(terminal.writes())
            await asyncio.sleep(0.15)
            assert len(terminal.writes()) > writes
            assert bank.armed
            assert "outputs unknown" not in bank.health.alarms

    session(virtual, body)


def test_silence_is_a_lost_connection_after_the_stated_misses(virtual):
    async def body(bank, terminal, readings):
        began = virtual.clock()
        terminal.faults = ["unheard"] * 8
        await bank.supervisor.wait_for(ConnectionState.FAULT)
        assert (virtual.clock() - began) / 1e9 == pytest.approx(0.31, abs=0.03)
        assert "3 requests in a row" in str(bank.health.last_error)
        terminal.faults = []
        await bank.supervisor.wait_for(ConnectionState.STREAMING)

    session(virtual, body)


def test_busy_is_tried_again_and_other_refusals_end_it(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        terminal.faults = [6, 6, 6, 6, 6, 6]
        await hold(bank, SIX, 0.4)
        assert bank.armed
        assert bank.health.events["terminal busy"] == 6
        terminal.faults = [4]
        await bank.supervisor.wait_for(ConnectionState.FAULT)
        assert isinstance(bank.supervisor.error, ConfigurationError)
        await asyncio.sleep(0.05)
        assert terminal.setpoints == [0] * 16

    session(virtual, body)


def test_a_write_that_was_refused_as_busy_makes_no_foreign_writer(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, SIX, 0.4)
        terminal.refuses = {23: 6}
        await hold(bank, [0.0] * 6, 0.16)
        assert "foreign writer" not in bank.health.alarms
        terminal.refuses = {}
        await hold(bank, SIX, 0.4)
        assert bank.armed
        assert not bank.health.alarms

    session(virtual, body)


def test_a_terminal_that_stays_busy_is_left_to_its_watchdog_and_asked_again(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, SIX, 0.4)
        terminal.refuses = {23: 6, 16: 6}
        await bank.supervisor.wait_for(ConnectionState.FAULT)
        assert "accepts no set-point" in str(bank.supervisor.error)
        await asyncio.sleep(20)
        assert terminal.setpoints == [0] * 16
        terminal.refuses = {}
        await bank.supervisor.wait_for(ConnectionState.STREAMING)
        assert not bank.armed

    session(virtual, body)


def test_misfit_answers_are_missed_passes(virtual):
    async def body(bank, terminal, readings):
        terminal.faults = [ProtocolError("valves", "answers 47 registers instead of 48", "look")]
        await asyncio.sleep(0.1)
        assert bank.state is ConnectionState.STREAMING
        assert "47 registers" in str(bank.health.last_error)

    session(virtual, body)


def test_a_terminal_without_valves_there_is_a_configuration_error(virtual):
    class Other(MemoryTerminal):
        def read(self, address, count):
            raise LookupError

    async def main():
        terminal = Other(virtual.clock)
        bank = build(virtual, terminal)
        with pytest.raises(DeviceErrors) as caught:
            await bank.connect()
        (error,) = caught.value.leaves()
        assert isinstance(error, ConfigurationError)
        assert "check kind and unit" in error.cure
        await bank.close()
        assert terminal.log == []

    virtual.run(main)


@pytest.mark.parametrize(
    ("kept", "fact"), [(0, "vents after 180 ms"), (None, "host side only"), (180, "180 ms")]
)
def test_the_watchdog_is_set_and_read_back(virtual, kept, fact):
    async def body(bank, terminal, readings):
        assert fact in bank.health.facts["watchdog"]
        assert terminal.watchdog_ms == (180 if kept is not None else None)

    session(virtual, body, terminal=lambda clock: MemoryTerminal(clock, watchdog_ms=kept))


def test_a_watchdog_that_stays_longer_is_a_configuration_error(virtual):
    class Stubborn(MemoryTerminal):
        def write(self, address, words):
            if address != 46100:
                super().write(address, words)

    async def main():
        bank = build(virtual, Stubborn(virtual.clock, watchdog_ms=5000))
        with pytest.raises(DeviceErrors, match="not connected") as caught:
            await bank.connect()
        assert "value 5000 ms, limit 180 ms" in caught.value.lines()[0]
        await bank.close()

    virtual.run(main)


def test_a_chamber_that_does_not_follow_is_named(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        terminal.stuck[3] = 20
        await hold(bank, SIX, 1.5)
        assert not [alarm for alarm in bank.health.alarms.active if "tracking" in alarm.key]
        await hold(bank, SIX, 1.0)
        (alarm,) = bank.health.alarms.active
        assert alarm.key == "chamber 0 tracking"
        assert (alarm.value, alarm.limit, alarm.unit) == (2000.0, 30_000.0, "Pa")
        assert bank.state is ConnectionState.DEGRADED
        terminal.stuck.clear()
        await hold(bank, SIX, 0.5)
        assert bank.state is ConnectionState.STREAMING

    session(virtual, body)


def test_diagnosis_and_negative_pressure_are_read(virtual):
    async def body(bank, terminal, readings):
        terminal.stuck[3] = -1
        terminal.diagnosis[2] = 31
        await asyncio.sleep(0.1)
        assert readings[-1].value.readback[0] == -100.0
        assert readings[-1].value.diagnosis == (0, 31, 0, 0, 0, 0)
        (alarm,) = bank.health.alarms.active
        assert (alarm.key, alarm.value) == ("chamber 1 diagnosis", "0x001f")

    session(virtual, body)


def test_an_observer_writes_nothing(virtual):
    def foreign(clock):
        terminal = MemoryTerminal(clock)
        terminal.setpoints[3] = 200
        return terminal

    async def body(bank, terminal, readings):
        await asyncio.sleep(0.5)
        with pytest.raises(InterlockError, match="observation only"):
            bank.arm()
        assert len(readings) > 40
        assert readings[-1].value.echo[0] == 20_000.0
        assert terminal.log == []

    session(virtual, body, terminal=foreign, observe=True)


def test_cancelling_the_owner_vents(virtual):
    async def main():
        terminal = MemoryTerminal(virtual.clock)

        async def owner():
            bank = build(virtual, terminal)
            await bank.connect()
            try:
                bank.arm()
                await hold(bank, SIX, 100)
            finally:
                await bank.close()

        task = asyncio.create_task(owner())
        await asyncio.sleep(1.0)
        assert any(terminal.setpoints)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert terminal.setpoints == [0] * 16

    virtual.run(main)


acts = st.one_of(
    st.tuples(st.just("command"), st.lists(st.floats(-1e3, 6e4), min_size=6, max_size=6)),
    st.tuples(st.just("fault"), st.sampled_from(["unheard", "unanswered", 6])),
    st.tuples(st.sampled_from(["arm", "vent", "clear", "foreign", "down", "up"]), st.none()),
)


class History:
    """Applies one act after the other."""

    def __init__(self, bank, terminal, clock):
        self.bank = bank
        self.terminal = terminal
        self.clock = clock
        self.asked_at = []

    def act(self, verb, detail):
        getattr(self, verb)(detail)

    def command(self, setpoint):
        with contextlib.suppress(LimitError, InterlockError):
            self.bank.command(setpoint, 0.2)
            self.asked_at.append(self.clock() / 1e9)

    def arm(self, _):
        with contextlib.suppress(InterlockError):
            self.bank.arm()

    def vent(self, _):
        self.bank.vent()

    def clear(self, _):
        self.terminal.clear_outputs()

    def foreign(self, _):
        self.terminal.setpoints[11] = 77

    def fault(self, detail):
        self.terminal.faults.append(detail)

    def down(self, _):
        self.terminal.down = True

    def up(self, _):
        self.terminal.down = False


@settings(max_examples=25, deadline=None)
@given(history=st.lists(st.tuples(acts, st.floats(0, 0.4)), max_size=25), exchange=st.booleans())
def test_no_history_exceeds_limit_slew_or_lifetime(virtual, history, exchange):
    """Whatever happens, each write keeps limit and slew, and no set-point outlives its lifetime."""

    async def main():
        terminal = MemoryTerminal(virtual.clock, functions=(3, 6, 16, 23) if exchange else (3, 6, 16))
        bank = build(virtual, terminal)
        await bank.connect()
        past = History(bank, terminal, virtual.clock)
        for (verb, detail), wait_s in history:
            past.act(verb, detail)
            await asyncio.sleep(wait_s)
        past.up(None)
        terminal.faults = []
        await bank.close()
        return terminal.writes(), past.asked_at

    writes, asked_at = virtual.run(main)
    for time, words in writes:
        assert all(0 <= word <= 500 for word in words)
        if any(words):
            assert any(asked <= time <= asked + 0.2 + PERIOD_S for asked in asked_at)
    for (before_s, before), (after_s, after) in pairwise(writes):
        allowed = 2000.0 * max(after_s - before_s, PERIOD_S) + 1.0
        assert all(rise - fall <= allowed for rise, fall in zip(after, before, strict=True))
