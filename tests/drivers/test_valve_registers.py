"""Pure parts of the valve driver: words, limits, chamber map, echo and tracking monitors."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from softarm.drivers.errors import LimitError
from softarm.drivers.valves.echo import EchoMonitor, Verdict
from softarm.drivers.valves.limits import PressureLimits, limit_lifetime, limit_step
from softarm.drivers.valves.pressures import ChamberMap
from softarm.drivers.valves.registers import MpaLayout, SlotStatus, VtemLayout, signed_all, unsigned
from softarm.drivers.valves.tracking import TrackingMonitor

words = st.integers(0, 0xFFFF)
counts = st.integers(-0x8000, 0x7FFF)


@given(counts)
def test_words_are_signed(count):
    assert signed_all([unsigned(count), 0xFFFF, 0x7FFF]) == (count, -1, 32767)


@pytest.mark.parametrize("count", [0x8000, -0x8001, 70_000])
def test_a_count_that_does_not_fit_is_refused(count):
    with pytest.raises(ValueError, match="16 bits"):
        unsigned(count)


@given(st.lists(words, min_size=48, max_size=48))
def test_mpa_words_fall_to_their_valves(block):
    inputs = MpaLayout().decode(block)
    for valve in range(16):
        assert inputs.actual[valve] % 0x10000 == block[3 * valve]
        assert -0x8000 <= inputs.actual[valve] <= 0x7FFF
        assert inputs.echo[valve] % 0x10000 == block[3 * valve + 1]
        assert inputs.diagnosis[valve] == block[3 * valve + 2]


@given(st.lists(counts, min_size=16, max_size=16))
def test_vtem_words_carry_the_command_and_two_pressures_per_slot(pressures):
    block = VtemLayout().encode(pressures)
    assert block[0::3] == [0b1100_0011] * 8
    assert VtemLayout().echo_of_outputs(block) == tuple(pressures)


@given(st.lists(words, min_size=24, max_size=24))
def test_a_vtem_slot_that_does_not_regulate_shows(block):
    inputs = VtemLayout().decode(block)
    for slot in range(8):
        word = block[3 * slot]
        healthy = word & 0x3F == 3 and word >> 6 & 3 == 2
        assert inputs.diagnosis[2 * slot] == (0 if healthy else word)
        assert inputs.actual[2 * slot + 1] % 0x10000 == block[3 * slot + 2]
    assert inputs.echo is None


def test_a_vtem_status_word_comes_apart():
    assert SlotStatus.decode(0x0583) == SlotStatus(mode=3, state=2)
    assert SlotStatus.decode(0x0083).regulating
    assert not SlotStatus.decode(0x00C3).regulating


LIMITS = PressureLimits((50_000.0, 40_000.0), slew=100_000.0, lifetime_s=1.0)
pressures = st.tuples(st.floats(0, 50_000), st.floats(0, 40_000))


@given(asked=pressures, before=pressures, seconds=st.floats(0, 1))
def test_a_step_goes_towards_the_setpoint_no_faster_than_slew(asked, before, seconds):
    applied = limit_step("valves", asked, before, LIMITS, seconds)
    for target, start, end in zip(asked, before, applied, strict=True):
        assert abs(end - start) <= LIMITS.slew * seconds + 1e-9
        assert min(start, target) - 1e-6 <= end <= max(start, target) + 1e-6
        if abs(target - start) <= LIMITS.slew * seconds:
            assert end == pytest.approx(target, abs=1e-6)


@given(st.lists(st.floats(), min_size=2, max_size=2), pressures)
def test_whatever_is_out_of_range_is_refused_and_never_clamped(asked, before):
    inside = all(
        math.isfinite(value) and 0 <= value <= most for value, most in zip(asked, LIMITS.maximum, strict=True)
    )
    if inside:
        limit_step("valves", asked, before, LIMITS, 0.01)
        return
    with pytest.raises(LimitError) as caught:
        limit_step("valves", asked, before, LIMITS, 0.01)
    assert caught.value.limit in LIMITS.maximum
    assert caught.value.unit == "Pa"
    assert "limit" in str(caught.value)


@pytest.mark.parametrize("lifetime_s", [0.0, -1.0, 1.1, math.nan, math.inf])
def test_a_lifetime_out_of_range_is_refused(lifetime_s):
    with pytest.raises(LimitError, match="lifetime"):
        limit_lifetime("valves", lifetime_s, LIMITS)


@given(st.permutations(range(16)), st.lists(st.floats(0, 50_000), min_size=6, max_size=6))
def test_chambers_go_to_their_valves_to_half_a_count(order, asked):
    chambers = ChamberMap(tuple(order[:6]), 16)
    told = chambers.to_counts(tuple(asked), (50_000.0,) * 6)
    assert all(told[valve] == 0 for valve in order[6:])
    for pressure, applied in zip(asked, chambers.to_pressures(told), strict=True):
        assert abs(applied - pressure) <= 50.0


@given(st.floats(0, 49_960), st.floats(0.0, 30.0))
def test_a_count_never_exceeds_the_maximum(most, below):
    assume(most >= below)
    (count,) = ChamberMap((0,), 1).to_counts((most - below,), (most,))
    assert count * 100.0 <= most


def test_echo_lag_begins_when_a_write_is_answered():
    """A terminal on a busy machine takes a request late; its echo then still shows the write before."""
    monitor = EchoMonitor(lag_ns=100)
    monitor.attempted((1,), 0)
    monitor.answered(5)
    monitor.attempted((2,), 10)
    monitor.answered(310)
    assert monitor.judge((1,), 310) is Verdict.OURS
    monitor.attempted((2,), 350)
    monitor.answered(400)
    assert monitor.judge((1,), 411) is Verdict.FOREIGN


def test_an_echo_is_ours_zeroed_or_foreign():
    monitor = EchoMonitor(lag_ns=100)
    monitor.attempted((0, 0), 0)
    monitor.attempted((5, 7), 50)
    assert monitor.judge((0, 0), 149) is Verdict.OURS
    assert monitor.judge((5, 7), 149) is Verdict.OURS
    assert monitor.judge((0, 0), 151) is Verdict.ZEROED
    assert monitor.judge((5, 8), 151) is Verdict.FOREIGN


@given(st.lists(st.tuples(st.integers(1, 50), st.tuples(counts, counts)), min_size=1, max_size=40))
def test_the_last_write_is_always_ours(history):
    monitor = EchoMonitor(lag_ns=100)
    now = 0
    for wait, written in history:
        now += wait
        monitor.attempted(written, now)
        assert monitor.judge(written, now) is Verdict.OURS


def track(monitor, applied, readback, until_ms, from_ms=0):
    outcome = None
    for now_ms in range(from_ms, until_ms, 10):
        (outcome,) = monitor.update((applied(now_ms),), (readback(now_ms),), now_ms * 1_000_000)
    return outcome


def monitor():
    return TrackingMonitor(1, reach_ns=1_000_000_000, tolerance=1000.0, confirm_ns=100_000_000)


@given(st.floats(50, 400), st.floats(1e3, 5e4), st.floats(0.1, 3))
def test_a_first_order_chamber_on_a_moving_setpoint_is_no_fault(lag_ms, amplitude, hertz):
    held = monitor()
    level = 0.0
    for now_ms in range(0, 5000, 10):
        asked = amplitude * (1 + math.sin(2 * math.pi * hertz * now_ms / 1000)) / 2
        level += (asked - level) * min(1.0, 10 / (lag_ms / 2))
        assert held.update((asked,), (level,), now_ms * 1_000_000) == (None,)


def test_a_step_may_take_its_time_and_no_longer():
    held = monitor()
    assert track(held, lambda _: 0.0, lambda _: 0.0, 2000) is None
    assert track(held, lambda _: 20_000.0, lambda _: 0.0, 3050, 2000) is None
    assert track(held, lambda _: 20_000.0, lambda _: 0.0, 3300, 3050) == pytest.approx(-20_000.0)
    assert track(held, lambda _: 20_000.0, lambda _: 19_500.0, 3400, 3300) is None


def test_a_chamber_that_does_not_vent_is_a_fault():
    held = monitor()
    track(held, lambda _: 20_000.0, lambda _: 20_000.0, 2000)
    assert track(held, lambda _: 0.0, lambda _: 20_000.0, 4000, 2000) == pytest.approx(20_000.0)


def test_what_was_asked_before_the_connection_is_no_fault():
    held = monitor()
    assert track(held, lambda _: 0.0, lambda now: 20_000.0 * math.exp(-now / 200), 3000) is None
