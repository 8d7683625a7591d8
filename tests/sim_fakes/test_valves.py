"""The fake terminals: registers, watchdog, status, regulators, slots."""

import numpy as np
import pytest

from softarm.fakes.faults import FaultBoard
from softarm.fakes.signals import unmodified
from softarm.fakes.valves.modbus import execute
from softarm.fakes.valves.mpa import MpaBank, bank_faults
from softarm.fakes.valves.node import CpxNode, ModbusError, node_faults
from softarm.fakes.valves.pneumatics import MBAR, Pneumatics, Regulators
from softarm.fakes.valves.server import WIRE_FAULTS
from softarm.fakes.valves.vtem import LOWEST_MBAR, VtemBank, vtem_faults

STEP = 0.002


def terminal(vtem=False, **options):
    faults = FaultBoard(
        "valves", (*WIRE_FAULTS, *node_faults(16), *(vtem_faults() if vtem else bank_faults(16)))
    )
    if vtem:
        figures = Regulators(supply=800e3, lowest=LOWEST_MBAR * MBAR, bias=(0.0, 200.0))
        return CpxNode(VtemBank(faults, figures, 0, unmodified), faults, **options)
    return CpxNode(MpaBank(faults, 16, Regulators(), 0, unmodified), faults, **options)


def run(node, begin, seconds):
    """Step a node; return the time at the end."""
    steps = round(seconds / STEP)
    for k in range(1, steps + 1):
        node.update(begin + k * STEP)
    return begin + steps * STEP


def hexed(node, text):
    return execute(node, bytes.fromhex(text)).hex(" ")


def test_registers_outside_the_areas_do_not_exist():
    node = terminal()
    for address, count in ((40000, 1), (40257 + 8, 1), (45391, 2), (45647, 2), (46100, 2), (0, 1)):
        with pytest.raises(ModbusError) as caught:
            node.read(address, count)
        assert caught.value.code == 2
    for address in (45392, 45357, 45648, 39999, 46101):
        with pytest.raises(ModbusError):
            node.write(address, [1])


def test_a_write_that_reaches_past_the_outputs_changes_nothing():
    node = terminal()
    with pytest.raises(ModbusError):
        node.write(40255, [7] * 5)
    assert node.read(40255, 2) == [0, 0]


@pytest.mark.parametrize(
    ("request_pdu", "answer"),
    [
        ("04 b1 53 00 01", "84 01"),
        ("03 b1 53 00 00", "83 03"),
        ("03 b1 53 00 7e", "83 03"),
        ("03 b1 53", "83 03"),
        ("10 9c 43 00 02 03 00 00 00", "90 03"),
        ("06 b1 53 00 01", "86 02"),
        ("2b 0e 04 00", "2b 0e 04 01 00 00 01 00 05 46 65 73 74 6f"),
        ("2b 0e 04 07", "ab 02"),
        ("2b 0d 01 00", "ab 03"),
    ],
)
def test_answers_to_odd_requests(request_pdu, answer):
    assert hexed(terminal(), request_pdu) == answer


def test_every_fault_has_its_own_name():
    for vtem in (False, True):
        board = terminal(vtem).faults
        assert len(board.catalogue) == len(WIRE_FAULTS) + 3 + 4


def test_the_watchdog_is_clamped_fires_once_and_then_waits_for_a_master():
    node = terminal()
    node.write(46100, [30])
    assert node.read(46100, 1) == [100]
    node.note_request(0.0)
    node.write(40003, [300])
    time = run(node, 0.0, 0.1)
    assert node.read(40003, 1) == [300]
    time = run(node, time, 0.01)
    assert node.read(40003, 1) == [0]
    assert node.watchdog_trips == 1
    node.write(40003, [200])
    node.note_request(time)
    time = run(node, time, 0.09)
    assert node.read(40003, 1) == [200]
    run(node, time, 1.0)
    assert node.watchdog_trips == 2
    node.write(46100, [0])
    assert node.read(46100, 1) == [0]


def test_function_4402_makes_the_fail_safe_hold_the_outputs():
    node = terminal(watchdog_ms=100)
    node.write(40002, [1])
    node.write(40001, [0])
    node.write(40001, [0x8000 | 0x2000 | 4402])
    assert node.read(45392, 2) == [0x8000 | 4402, 1]
    node.note_request(0.0)
    node.write(40003, [300])
    run(node, 0.0, 0.5)
    assert node.watchdog_trips == 1
    assert node.read(40003, 1) == [300]


def test_status_block_and_diagnosis_numbers_name_the_faulty_module():
    node = terminal()
    assert node.read(45367, 3) == [0xFFFF, 0x0001, 0]
    assert node.read(45383, 3) == [0, 0, 0]
    node.faults.set("valve_fault", {"channel": 2, "code": 31})
    run(node, 0.0, 0.01)
    assert node.read(45383, 3) == [0b1000, 0, 0]
    assert node.read(45397 + 6, 1) == [31]
    node.write(40001, [0x8000 | 1937])
    assert node.read(45393, 1) == [3]
    node.write(40001, [0])
    node.write(40001, [0x8000 | (2008 + 4 * 3 + 1)])
    assert node.read(45393, 1) == [31]


def test_below_zero_reads_as_two_s_complement():
    node = terminal()
    node.faults.set("reading_offset", {"channel": 0, "mbar": -200})
    run(node, 0.0, 0.01)
    assert node.read(45395, 1)[0] == pytest.approx(0x10000 - 200, abs=2)


def test_a_negative_set_point_throws_the_regulator_open():
    node = terminal()
    node.write(40003, [0xFFFF])
    run(node, 0.0, 1.0)
    assert node.pressures()[0] > 200e3


class TestRegulators:
    """Against the figures of the recorded valve steps."""

    def step(self, seed):
        valves = Pneumatics(3, Regulators(), seed)
        free = np.ones(3, dtype=bool)
        times, readings = [], []
        for k in range(1, 1001):
            setpoints = np.full(3, 30e3 if k * STEP > 0.1 else 0.0)
            valves.advance(k * STEP, setpoints, 250e3, free)
            times.append(k * STEP - 0.1)
            readings.append(valves.readings())
        return np.array(times), np.array(readings)

    def test_dead_time_overshoot_and_bias(self):
        times, readings = self.step(1)
        for valve in range(3):
            reading = readings[:, valve]
            begins = times[np.flatnonzero(reading > 1e3)[0]]
            assert 0.04 <= begins <= 0.065
            assert 33e3 < reading.max() < 55e3
            assert -950.0 < reading[-200:].mean() - 30e3 < -450.0

    def test_the_outlet_itself_does_not_overshoot(self):
        valves = Pneumatics(1, Regulators(), 1)
        for k in range(1, 1001):
            valves.advance(k * STEP, np.array([30e3]), 250e3, np.array([True]))
            assert valves.pressures[0] <= 30e3

    def test_exhaust_is_choked(self):
        valves = Pneumatics(1, Regulators(), 1)
        level = []
        for k in range(1, 1501):
            valves.advance(k * STEP, np.array([30e3 if k < 1000 else 0.0]), 250e3, np.array([True]))
            level.append(valves.pressures[0])
        drops = -np.diff(level[1000:]) / STEP
        assert drops.max() == pytest.approx(270e3, rel=0.01)
        assert level[-1] < 100.0

    def test_the_spread_between_valves_comes_from_the_seed(self):
        first, again, other = (self.step(seed)[1] for seed in (1, 1, 2))
        assert np.array_equal(first, again)
        assert not np.array_equal(first, other)

    def test_supply_limits_every_outlet(self):
        node = terminal()
        node.faults.set("supply_missing", {"mbar": 50.0})
        node.write(40003, [300] * 16)
        run(node, 0.0, 1.0)
        assert node.pressures().max() <= 5e3
        assert node.read(45397, 1) == [26]


class TestSlots:
    """The VTEM state machine."""

    def activate(self, node):
        time = run(node, 0.0, 0.6)
        node.write(40003, [62 | 1 << 6, 0, 0])
        time = run(node, time, 0.5)
        node.write(40003, [3 | 3 << 6, 0, 0])
        return run(node, time, 1.0)

    def test_a_slot_boots_is_acknowledged_and_runs(self):
        node = terminal(vtem=True)
        assert node.read(45395, 1) == [61]
        run(node, 0.0, 0.6)
        assert node.read(45395, 1) == [61 | 1 << 6]
        node = terminal(vtem=True)
        self.activate(node)
        assert node.read(45395, 1) == [3 | 2 << 6]

    def test_set_points_count_only_while_it_runs_with_the_valve_selected(self):
        node = terminal(vtem=True)
        node.write(40003, [0, 300, 300])
        time = run(node, 0.0, 1.0)
        assert node.pressures()[0] == 0.0
        time = self.activate(node)
        node.write(40003, [3 | 2 << 6, 300, 300])
        time = run(node, time, 3.0)
        assert node.pressures()[0] > 28e3
        assert node.pressures()[1] == 0.0
        node.write(40003, [61, 0, 0])
        run(node, time, 2.0)
        assert node.pressures()[0] < 100.0
        assert node.read(45395, 1) == [61 | 1 << 6]

    def test_vacuum_is_possible(self):
        node = terminal(vtem=True)
        time = self.activate(node)
        node.write(40004, [0x10000 - 500])
        run(node, time, 2.0)
        assert node.pressures()[0] == pytest.approx(-50e3, abs=1e3)

    @pytest.mark.parametrize("word", [5, 17])
    def test_an_unknown_mode_is_an_error_until_acknowledged(self, word):
        node = terminal(vtem=True)
        time = run(node, 0.0, 0.6)
        node.write(40003, [word])
        time = run(node, time, 0.5)
        assert node.read(45395, 1)[0] >> 6 == 3
        assert node.read(45383, 1) == [0b10]
        node.write(40003, [3 | 3 << 6])
        time = run(node, time, 1.5)
        assert node.read(45395, 1)[0] >> 6 == 3
        node.write(40003, [62])
        run(node, time, 0.5)
        assert node.read(45395, 1)[0] >> 6 == 1

    def test_a_set_point_out_of_range_is_an_error(self):
        node = terminal(vtem=True)
        time = self.activate(node)
        node.write(40004, [7001])
        run(node, time, 0.1)
        assert node.read(45395, 1)[0] >> 6 == 3
