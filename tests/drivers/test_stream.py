"""Readings: what they carry, and a receiver that fails."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from softarm.drivers.health import COUNTERS, Health, Histogram
from softarm.drivers.stream import ReadingStream


class HandClock:
    def __init__(self):
        self.now_ns = 0

    def __call__(self):
        return self.now_ns


def build(sink=lambda reading: None):
    clock = HandClock()
    health = Health()
    return (
        ReadingStream("gauge", "fake+pty:gauge", health=health, sink=sink, clock=clock),
        health,
        clock,
    )


def test_a_sample_without_counter_among_others_takes_the_next_number():
    stream, _, _ = build()
    numbers = [stream.publish(1.0, sequence=sequence).sequence for sequence in (40, None, 42, None)]
    assert numbers == [40, 41, 42, 43]
    stream.start_epoch("restarted")
    assert stream.publish(1.0).sequence == 0


def test_a_reading_tells_where_and_when_it_was_taken():
    taken = []
    stream, health, clock = build(taken.append)
    clock.now_ns = 5_000
    stream.publish(1.5, device_time_ns=700)
    (reading,) = taken
    assert reading == stream.latest
    assert reading.source == "fake+pty:gauge"
    assert (reading.host_monotonic_ns, reading.device_time_ns, reading.epoch) == (5_000, 700, 0)
    assert health.frames == 1


def test_a_new_epoch_restarts_the_count_and_is_counted():
    stream, health, _ = build()
    stream.publish(1.0)
    stream.start_epoch("measurement restarted")
    assert (stream.publish(2.0).epoch, stream.latest.sequence) == (1, 0)
    assert health.events == {"measurement restarted": 1}


def test_a_failing_receiver_is_counted_and_harms_nothing(caplog):
    def sink(reading):
        raise ValueError("full")

    stream, health, _ = build(sink)
    for _ in range(3):
        stream.publish(1.0)
    assert (health.frames, health.sink_errors) == (3, 3)
    assert len(caplog.records) == 1


def test_the_summary_holds_every_counter():
    _, health, _ = build()
    health.alarms.set("stale", "no valid reading", "look", value=1.0, limit=0.5, unit="s")
    summary = health.summary()
    assert set(COUNTERS) <= set(summary)
    assert summary["alarms"][0]["key"] == "stale"


@given(st.lists(st.integers(0, 10**12), min_size=1, max_size=200), st.floats(0, 1))
def test_quantiles_are_right_to_one_bin(durations, fraction):
    histogram = Histogram()
    for duration in durations:
        histogram.add(duration)
    told = histogram.quantile_ns(fraction)
    reached = sum(duration <= told for duration in durations)
    assert reached >= fraction * len(durations) - 1e-9
    below = sum(duration < told * 8 / 9 - 1 for duration in durations)
    assert below <= max(fraction * len(durations), 1)
    assert histogram.mean_ns == pytest.approx(sum(durations) / len(durations))


@given(st.integers(0, 10**15))
def test_a_single_duration_is_its_own_quantile(duration):
    histogram = Histogram()
    histogram.add(duration)
    assert histogram.quantile_ns(0.5) == histogram.largest_ns == duration
