"""Readings of several streams at common times."""

import numpy as np

from softarm.estimator.series import interpolate, joined, nearest, runs, window_means

LOST = np.nan


def test_a_long_gap_is_not_bridged() -> None:
    time = np.array([0.0, 0.1, 0.2, 1.2])
    values = interpolate(np.array([0.05, 0.2, 0.7, 1.2]), time, np.array([0.0, 1.0, LOST, 3.0]))
    np.testing.assert_allclose(values, [0.5, 1.0 + 2.0 / 11.0, LOST, 3.0])


def test_the_nearest_reading_within_reach_counts() -> None:
    time, values = np.array([0.0, 1.0, 2.0]), np.array([5.0, 6.0, 7.0])
    found = nearest(np.array([-0.4, -0.6, 0.4, 0.5, 0.6, 2.4, 2.6]), time, values, 0.5)
    np.testing.assert_array_equal(found, [5.0, LOST, 5.0, 5.0, 6.0, 7.0, LOST])


def test_means_leave_lost_readings_and_empty_windows_out() -> None:
    values = np.array([[1.0, LOST], [3.0, 4.0], [5.0, LOST]])
    means = window_means(values, np.array([0, 0, 2]), 3)
    np.testing.assert_array_equal(means, [[2.0, 4.0], [LOST, LOST], [5.0, LOST]])


def test_runs_reach_to_both_ends() -> None:
    assert runs(np.array([True, True, False, True])) == [(0, 2), (3, 4)]
    assert runs(np.zeros(3, dtype=bool)) == runs(np.zeros(0, dtype=bool)) == []


def test_moments_that_follow_closely_are_one_stretch() -> None:
    assert joined([1.0, 2.0, 4.5, 7.0], 2.5) == [(1.0, 7.0)]
    assert joined([1.0, 2.0, 4.5, 7.0], 1.0) == [(1.0, 2.0), (4.5, 4.5), (7.0, 7.0)]
    assert joined([], 1.0) == []
