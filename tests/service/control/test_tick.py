from hypothesis import given
from hypothesis import strategies as st

from softarm.daemon.control.lateness import SkippedTicks
from softarm.daemon.control.tick import Ticker, TickSchedule

INTERVAL = 10_000_000


@given(st.lists(st.integers(min_value=0, max_value=5 * INTERVAL), min_size=1, max_size=50))
def test_schedule_stays_on_its_grid_and_counts_what_it_skips(delays):
    schedule = TickSchedule(start_ns=0, interval_ns=INTERVAL)
    now, taken, missed = 0, 0, 0
    for delay in delays:
        now = max(now, schedule.next_deadline_ns) + delay
        tick = schedule.begin_tick(now)
        taken += 1
        missed += tick.missed
        assert tick.deadline_ns % INTERVAL == 0
        assert 0 <= tick.drift_ns < INTERVAL
        assert tick.late_ns == tick.drift_ns + tick.missed * INTERVAL
        assert schedule.next_deadline_ns > now
    assert taken + missed == tick.index + 1


async def test_ticker_ticks_and_stops():
    with Ticker(interval_s=0.002) as ticker:
        indices = []
        async for tick in ticker.ticks():
            indices.append(tick.index)
            if len(indices) == 20:
                break
    assert indices == sorted(set(indices))


def test_skipped_ticks_count_for_a_second_however_many_there_are() -> None:
    skipped = SkippedTicks()
    skipped.add(0, 1500)
    skipped.add(400_000_000, 0)
    skipped.add(600_000_000, 2)
    assert [skipped.recent(now_ns) for now_ns in (700_000_000, 1_000_000_000, 1_600_000_000)] == [1502, 2, 0]
    assert skipped.total == 1502
