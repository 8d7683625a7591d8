"""The VTEM terminal: brought into regulation, watched, and put away, in virtual time."""

import asyncio

import pytest

from softarm.drivers.errors import DeviceErrors, InterlockError
from softarm.drivers.supervisor import ConnectionState
from tests.drivers.valve_rig import MemoryTerminal, build_vtem

SIX = [30_000.0, 0.0, 10_000.0, 0.0, 5_000.0, 0.0]


class MemoryVtem(MemoryTerminal):
    """Eight slots at 45395 + 3 s (status, actual A, actual B) and 40003 + 3 s (command, set-points)."""

    def __init__(self, clock, *, ready_after_s=1.0, reads_outputs=True, **options):
        super().__init__(clock, **options)
        self.setpoints = [0] * 24
        self.actual = [0.0] * 24
        self.ready_after_s = ready_after_s
        self.reads_outputs = reads_outputs
        self.failed, self.broken = set(), set()
        self._since = {}

    def clear_outputs(self):
        self.setpoints = [0] * 24

    def status(self, slot):
        mode, control = self.setpoints[3 * slot] & 0x3F, self.setpoints[3 * slot] >> 6 & 3
        if slot in self.failed | self.broken:
            return 3 | 3 << 6
        if mode != 3:
            self._since.pop(slot, None)
            return mode | 1 << 6
        since = self._since.setdefault(slot, self.clock())
        running = control == 3 and (self.clock() - since) / 1e9 >= self.ready_after_s
        return 3 | (2 if running else 1) << 6

    def read(self, address, count):
        if address == 45395 and count == 24:
            words = [round(value) & 0xFFFF for value in self.actual]
            words[0::3] = [self.status(slot) for slot in range(8)]
            return words
        if address == 40003 and count == 24 and self.reads_outputs:
            return list(self.setpoints)
        if address == 46100 and self.watchdog_ms is not None:
            return [self.watchdog_ms]
        raise LookupError

    def write(self, address, words):
        self.log.append((self.clock(), address, list(words)))
        if address == 40003:
            self.setpoints = list(words)
            self.failed -= {slot for slot in range(8) if words[3 * slot] & 0x3F == 62}
        elif address == 46100:
            self.watchdog_ms = words[0]


def session(virtual, body, **options):
    async def main():
        terminal = MemoryVtem(virtual.clock, **options)
        readings = []
        bank = build_vtem(virtual, terminal, readings.append)
        await bank.connect()
        try:
            await body(bank, terminal, readings)
        finally:
            await bank.close()
        return terminal

    return virtual.run(main)


async def hold(bank, seconds):
    for _ in range(round(seconds / 0.02)):
        bank.command(SIX, 0.2)
        await asyncio.sleep(0.02)


def test_slots_are_acknowledged_activated_and_put_away(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, 0.6)
        # Chambers 0, 1, 2, 4 are on valves 3, 2, 1, 4: slots 1 B, 1 A, 0 B, 2 A.
        assert terminal.setpoints[:9] == [0xC3, 0, 100, 0xC3, 0, 300, 0xC3, 50, 0]
        assert readings[-1].value.readback[0] == pytest.approx(30_000, abs=300)
        assert readings[-1].value.diagnosis == (0,) * 6

    terminal = session(virtual, body)
    commands = []
    for time, words in terminal.writes():
        assert len(set(words[0::3])) == 1
        if not commands or commands[-1][1] != words[0]:
            commands.append((time, words[0]))
    assert [command for _, command in commands] == [62 | 1 << 6, 0xC3, 61]
    assert commands[1][0] - commands[0][0] >= 0.5
    zeros = [time for time, words in terminal.writes() if words == [0xC3, 0, 0] * 8]
    assert commands[2][0] - zeros[-1] >= 1.0
    assert terminal.setpoints[1::3] == terminal.setpoints[2::3] == [0] * 8


def test_a_slot_that_never_regulates_is_named_and_tried_again(virtual):
    async def main():
        terminal = MemoryVtem(virtual.clock)
        terminal.broken = {5}
        bank = build_vtem(virtual, terminal)
        with pytest.raises(DeviceErrors) as caught:
            await bank.connect()
        assert "slot 5 does not regulate (limit 20.0 s)" in caught.value.lines()[0]
        terminal.broken = set()
        await bank.supervisor.wait_for(ConnectionState.STREAMING)
        await bank.close()

    virtual.run(main)


def test_a_slot_in_error_is_an_alarm_of_its_chambers(virtual):
    async def body(bank, terminal, readings):
        terminal.failed = {0}
        await asyncio.sleep(0.1)
        named = {alarm.key: alarm.value for alarm in bank.health.alarms.active}
        assert named == {"chamber 2 diagnosis": "0x00c3", "chamber 3 diagnosis": "0x00c3"}
        assert bank.state is ConnectionState.DEGRADED

    session(virtual, body)


def test_a_slot_keeps_its_error_until_it_is_acknowledged_while_vented(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, 0.6)
        assert not bank.acknowledge()
        terminal.failed = {0}
        await asyncio.sleep(0.1)
        with pytest.raises(InterlockError, match="is armed"):
            bank.acknowledge()
        bank.vent()
        await asyncio.sleep(5.0)
        assert terminal.failed == {0}
        written = len(terminal.writes())
        assert bank.acknowledge()
        await asyncio.sleep(2.0)
        assert terminal.failed == set()
        assert bank.health.alarms.active == ()
        assert not bank.armed
        words = [words for _, words in terminal.writes()][written:]
        assert {word[0] for word in words} == {62 | 1 << 6, 0xC3}
        assert {word for line in words for word in line[3::3]} == {0xC3}

    session(virtual, body)


def test_cleared_outputs_are_seen_in_the_output_block(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, 0.4)
        terminal.clear_outputs()
        with pytest.raises(InterlockError, match="cleared its outputs"):
            await hold(bank, 1.0)

    session(virtual, body)


def test_a_terminal_whose_outputs_cannot_be_read_is_used_without_echo(virtual):
    async def body(bank, terminal, readings):
        bank.arm()
        await hold(bank, 0.4)
        assert readings[-1].value.echo is None
        assert bank.health.facts["set-points found"] == "cannot be read"

    session(virtual, body, reads_outputs=False)
