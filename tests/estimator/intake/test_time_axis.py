"""The time column: its unit, and its pauses."""

import re
from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.intake import take_in
from softarm.estimator.intake.time_axis import mend_time
from softarm.estimator.recording import Recording
from tests.estimator.intake import small_arm as arm

SPECIMEN = arm.specimen()


@pytest.fixture(scope="module")
def good() -> Recording:
    return arm.small_arm(seconds=20.0)


@pytest.mark.parametrize("jump", [1e4, 1e5, 1.6e9])
def test_a_clock_that_jumps_is_refused_with_row_and_size(good: Recording, jump: float) -> None:
    time = good.time + jump * (np.arange(len(good.time)) >= 300)
    (refusal,) = take_in(replace(good, time=time), SPECIMEN).refusals
    size = "1.6e+09" if jump > 1e9 else f"{jump:.0f}"
    assert re.search(rf"goes on by {re.escape(size)} s from row 300 to row 301, its usual", str(refusal))


def test_the_pauses_between_the_runs_of_a_series_are_accepted(good: Recording) -> None:
    time = good.time + 900.0 * (np.arange(len(good.time)) // 100)
    mended, faults = mend_time(replace(good, time=time), SPECIMEN)
    assert not faults
    np.testing.assert_array_equal(mended.time, time)
