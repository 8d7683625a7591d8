"""The time column: its unit, and its pauses."""

import re
from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.intake import check_recording
from softarm.estimator.intake.time_axis import correct_time
from softarm.estimator.recording import Recording
from tests.estimator.intake import small_arm as arm

SPECIMEN = arm.specimen()


@pytest.fixture(scope="module")
def good() -> Recording:
    return arm.small_arm(seconds=20.0)


@pytest.mark.parametrize("jump", [1e4, 1e5, 1.6e9])
def test_a_clock_that_jumps_is_refused_with_row_and_size(good: Recording, jump: float) -> None:
    time = good.time + jump * (np.arange(len(good.time)) >= 300)
    (refusal,) = check_recording(replace(good, time=time), SPECIMEN).refusals
    size = "1.6e+09" if jump > 1e9 else f"{jump:.0f}"
    assert re.search(rf"goes on by {re.escape(size)} s from row 300 to row 301, its usual", str(refusal))


def test_the_pauses_between_the_runs_of_a_series_are_accepted(good: Recording) -> None:
    time = good.time + 900.0 * (np.arange(len(good.time)) // 100)
    corrected, faults = correct_time(replace(good, time=time), SPECIMEN)
    assert not faults
    np.testing.assert_array_equal(corrected.time, time)


@pytest.mark.parametrize("factor", [1.0, 10.0, 20.0, 1e3 / 60.0])
def test_steps_that_agree_with_the_stated_rate_in_no_unit_are_refused(good: Recording, factor: float) -> None:
    stated = {**good.info, "rate_hz": 100.0}
    (refusal,) = check_recording(replace(good, time=factor * good.time, info=stated), SPECIMEN).refusals
    words = rf"rises by {0.05 * factor:.4g} a sample at a stated rate of 100 Hz, which agrees in no unit"
    assert re.search(words, str(refusal))
    assert ("count the samples" in str(refusal)) == (factor == 20.0)


@pytest.mark.parametrize("step", [0.5, 1.0, 2.0])
def test_slow_steps_without_a_stated_rate_are_refused(good: Recording, step: float) -> None:
    time = step * np.arange(len(good.time))
    (refusal,) = check_recording(replace(good, time=time), SPECIMEN).refusals
    assert f"rises by {step:g} from sample to sample, too slow" in str(refusal)
    assert not correct_time(replace(good, time=time, info={"rate_hz": 1.0 / step}), SPECIMEN)[1]


def test_rows_that_were_left_out_agree_with_the_stated_rate(good: Recording) -> None:
    kept = good.window(np.random.default_rng(0).random(len(good.time)) < 0.25)
    assert not correct_time(replace(kept, info={"rate_hz": arm.RATE}), SPECIMEN)[1]


@pytest.mark.parametrize("factor", [1.0, 1e3])
def test_streams_with_time_stamps_of_their_own_agree_with_the_stated_rate(factor: float) -> None:
    turns = np.arange(900) % 3
    time = factor * np.sort(np.concatenate([0.05 * np.arange(300) + late for late in (0.0, 1e-4, 3e-4)]))
    columns = {f"pressure_{k}_pa": np.where(turns == k, 1e3, np.nan) for k in range(3)}
    corrected, faults = correct_time(Recording("run", time, columns, {"rate_hz": 20.0}), SPECIMEN)
    assert len(faults) == (factor > 1.0)
    np.testing.assert_allclose(corrected.time, time / factor)
