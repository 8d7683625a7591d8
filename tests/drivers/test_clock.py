"""Host time: the clock map under skew and jitter, and the tick that skips."""

import asyncio
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softarm.drivers.clock import PollTicker
from softarm.drivers.clock_map import ClockMap

SECOND = 1_000_000_000
MILLISECOND = 1_000_000


def arrivals(seed, skew, floor_ns, spread_ns, seconds, rate_hz=100, start_ns=0):
    """True host time of each sample, its device time, and when it arrived."""
    random = Random(seed)
    for index in range(int(seconds * rate_hz)):
        true_ns = start_ns + index * SECOND // rate_hz
        device_ns = round((true_ns - start_ns) * (1 + skew)) + 7_000_000
        late_ns = floor_ns + round(random.expovariate(1.0) * spread_ns)
        yield true_ns, device_ns, true_ns + late_ns


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 1000),
    skew=st.floats(-1e-4, 1e-4),
    spread_ns=st.integers(1000, 5 * MILLISECOND),
    start_ns=st.integers(0, 10**15),
)
def test_mapped_times_lose_the_jitter_and_follow_the_skew(seed, skew, spread_ns, start_ns):
    clock_map = ClockMap()
    floor_ns = 2 * MILLISECOND
    worst_ns = 0
    for index, (true_ns, device_ns, host_ns) in enumerate(
        arrivals(seed, skew, floor_ns, spread_ns, 60, start_ns=start_ns)
    ):
        mapped_ns = clock_map.update(device_ns, host_ns)
        assert mapped_ns <= host_ns
        if index > 1500:
            worst_ns = max(worst_ns, abs(mapped_ns - true_ns - floor_ns))
    # The fastest of 50 arrivals is late by a fiftieth of the spread; the rest is the error of the slope.
    assert worst_ns < 0.25 * spread_ns + 20_000
    assert clock_map.skew == pytest.approx(-skew, abs=3e-6 + spread_ns / SECOND / 50)


def test_a_new_epoch_starts_the_filter_again():
    clock_map = ClockMap()
    for _, device_ns, host_ns in arrivals(1, 0.0, MILLISECOND, MILLISECOND, 10):
        clock_map.update(device_ns, host_ns, epoch=0)
    restarted = clock_map.update(5, 20 * SECOND, epoch=1)
    assert restarted == 20 * SECOND
    assert clock_map.skew == 0.0


def test_without_a_new_epoch_an_arrival_never_precedes_its_measurement():
    clock_map = ClockMap()
    clock_map.update(0, 10 * SECOND)
    assert clock_map.update(100 * SECOND, 11 * SECOND) == 11 * SECOND


@given(st.lists(st.tuples(st.integers(0, 10**13), st.integers(0, 10**13), st.integers(0, 2)), max_size=200))
def test_any_history_maps_without_error_and_not_into_the_future(history):
    clock_map = ClockMap()
    for device_ns, host_ns, epoch in history:
        assert clock_map.update(device_ns, host_ns, epoch) <= host_ns


def test_ticks_keep_their_times(virtual):
    async def main():
        ticker = PollTicker(10 * MILLISECOND, virtual.clock)
        began = virtual.clock()
        for index in range(1, 6):
            await asyncio.sleep(0.004)
            tick = await ticker.wait()
            assert (tick.index, tick.skipped) == (index, 0)
            assert virtual.clock() - began == pytest.approx(index * 10 * MILLISECOND, abs=1000)

    virtual.run(main)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0, 0.1), min_size=1, max_size=30))
def test_an_overrun_skips_and_never_bursts(virtual, busy):
    async def main():
        ticker = PollTicker(10 * MILLISECOND, virtual.clock)
        began = previous = virtual.clock()
        skipped = 0
        for busy_s in busy:
            await asyncio.sleep(busy_s)
            tick = await ticker.wait()
            now = virtual.clock()
            assert now - began >= tick.index * 10 * MILLISECOND - 1000
            assert tick.drift_ns <= 1000
            assert now > previous
            previous = now
            skipped += tick.skipped
        assert tick.index == len(busy) + skipped
        assert ticker.overruns == skipped

    virtual.run(main)
