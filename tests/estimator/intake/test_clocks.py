"""Shifts between clocks: what a linear law leaves of a nonlinear response is no reason to move a stream."""

import numpy as np
import pytest

from softarm.estimator.intake.clocks import Shifts, _strayed, likelihoods

LAGS = np.arange(-8.0, 8.01, 0.05)
SAMPLES = 25.0


def strayed(at_rest: float, elsewhere: float):
    """Judge a sensor of which a shift of 4.5 s leaves another share than no shift."""
    left = np.full(len(LAGS), 0.8)
    left[np.abs(LAGS) < 0.2] = at_rest
    left[np.abs(LAGS - 4.5) < 0.2] = elsewhere
    one = likelihoods(left, SAMPLES)
    return _strayed(Shifts(("frame_tip",), LAGS, one[None], SAMPLES), one)


@pytest.mark.parametrize(("at_rest", "elsewhere"), [(0.033, 0.018), (0.015, 0.010), (0.1, 0.09)])
def test_a_motion_that_no_shift_explains_already_is_not_moved(at_rest, elsewhere):
    assert strayed(at_rest, elsewhere) is None


def test_a_motion_that_only_a_shift_explains_is_moved():
    lag, *_ = strayed(0.5, 0.05)
    assert lag == pytest.approx(4.5, abs=0.2)
