"""Shifts between clocks: what a linear law leaves of a nonlinear response is no reason to move a stream."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from softarm.estimator.intake.clocks import DELAY, Shifts, _strayed, correct_clocks, find_delays, likelihoods
from softarm.estimator.recording import Recording
from tests.estimator.intake.small_arm import LIMIT, both, shifted, small_arm, specimen

LAGS = np.arange(-8.0, 8.01, 0.05)
SAMPLES = 25.0


def shares(at_rest: float, elsewhere: float) -> np.ndarray:
    left = np.full(len(LAGS), 0.8)
    left[np.abs(LAGS) < 0.2] = at_rest
    left[np.abs(LAGS - 4.5) < 0.2] = elsewhere
    return likelihoods(left, SAMPLES)


def strayed(at_rest: float, elsewhere: float, fitted: tuple[float, float] | None = None):
    """Judge a sensor of which a shift of 4.5 s leaves another share than no shift."""
    one, fit = shares(at_rest, elsewhere), shares(*(fitted or (at_rest, elsewhere)))
    return _strayed(Shifts(("frame_tip",), LAGS, one[None], fit[None], SAMPLES), one, fit)


@pytest.mark.parametrize(("at_rest", "elsewhere"), [(0.033, 0.018), (0.015, 0.010), (0.1, 0.09)])
def test_a_motion_that_no_shift_explains_already_is_not_moved(at_rest, elsewhere):
    assert strayed(at_rest, elsewhere) is None


def test_a_motion_that_only_a_shift_explains_is_moved():
    lag, *_ = strayed(0.5, 0.05)
    assert lag == pytest.approx(4.5, abs=0.2)


@pytest.mark.parametrize(
    ("fitted", "moved"), [((0.02, 0.04), False), ((0.04, 0.02), False), ((0.3, 0.02), True)]
)
def test_a_shift_that_predicts_poses_by_chance_does_not_fit_them(fitted, moved):
    assert (strayed(0.64, 0.2, fitted) is not None) is moved


@pytest.mark.parametrize("seed", range(16, 22))
def test_a_few_poses_of_a_nonlinear_arm_are_no_shift(seed):
    # Nine poses have fewer levels than the regression has coefficients, and all last equally long.
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 46.0, 0.05)
    levels = rng.uniform(0.2, 0.8, (11, 6)) * LIMIT * (rng.random((11, 6)) < 0.6)
    levels[[0, -1]] = 0.0
    acting = levels[np.clip((time + 1.0) // 4.5, 0, 10).astype(int)]
    linear = acting @ rng.normal(size=(6, 4)) / LIMIT
    bends = linear - 0.9 * np.maximum(linear - 0.2, 0.0) + rng.normal(0.0, 1e-3, linear.shape)
    columns = {f"pressure_{k}_pa": acting[:, k] for k in range(6)}
    columns |= {
        f"bend_{section}_{axis}_rad": bends[:, 2 * k + j]
        for k, section in enumerate(("intermediate", "tip"))
        for j, axis in enumerate("xy")
    }
    recording = Recording("poses", time, columns)
    assert correct_clocks(recording, specimen())[1] == ()


@pytest.mark.parametrize("lag", [-1.0, -0.6, -0.1, 0.0, 0.1, 0.6, 1.0])
@pytest.mark.parametrize("parts", [("bend",), ("frame",), ("bend", "frame", "marker")])
@pytest.mark.parametrize("seed", range(4))
def test_short_lags_of_all_sensors_are_named_and_none_where_there_is_none(seed, parts, lag):
    recording = shifted(("bend", "frame", "marker"), lag)(small_arm(seed, parts=parts))
    corrected, faults = correct_clocks(recording, specimen())
    if abs(lag) < 0.5:
        assert (corrected, faults) == (recording, ())
    elif parts == ("bend",):
        assert len(faults) == 1
    for fault in faults:  # poses of the laboratory are less linear than bends, so some tell nothing
        assert (fault.kind, fault.columns, fault.corrected) == ("clock", ("pressures",), True)
        assert float(fault.what.split()[3]) == pytest.approx(abs(lag), abs=0.2)
        assert ("behind" in fault.what) is (lag > 0.0)
        after = find_delays(corrected, specimen())
        best = after.lags[np.argmax(after.likelihoods.mean(axis=0))]
        assert DELAY[0] <= best <= DELAY[1]


@pytest.mark.parametrize("seconds", [0.2, 0.5])
def test_slow_lines_are_no_shift(seconds):
    recording = small_arm(1, parts=("bend",))
    keep = np.exp(-(recording.time[1] - recording.time[0]) / seconds)
    slow = {
        name: lfilter([1.0 - keep], [1.0, -keep], values)
        for name, values in recording.columns.items()
        if name.startswith("bend_")
    }
    late = replace(recording, columns={**recording.columns, **slow})
    assert correct_clocks(late, specimen())[1] == ()


def test_one_late_sensor_is_no_shift_of_the_clocks():
    late = shifted(("bend_tip",), 0.6)(small_arm(2, parts=("bend",)))
    assert correct_clocks(late, specimen())[1] == ()


@pytest.mark.parametrize("parts", [("bend",), ("frame",)])
def test_clocks_that_started_long_apart_are_moved_together_or_refused(parts):
    cases = [(seed, lag) for seed in range(3) for lag in (-15.0, -4.0, 3.0, 6.0, 12.0, 20.0)]
    corrected = 0
    for seed, lag in cases:
        recording = shifted(parts, lag)(small_arm(seed, parts=parts))
        _, (fault,) = correct_clocks(recording, specimen())
        assert (fault.kind, fault.columns) == ("clock", ("pressures",))
        if fault.corrected:  # some of the few poses say as much at another shift
            assert float(fault.what.split()[3]) == pytest.approx(abs(lag), abs=0.2)
            assert ("behind" in fault.what) is (lag > 0.0)
        corrected += fault.corrected
    assert corrected > 0.7 * len(cases)


@pytest.mark.parametrize("one", ["bend_tip", "frame_tip"])
def test_a_sensor_that_is_late_besides_all_others_is_moved_too(one):
    late = both(shifted(("bend", "frame", "marker"), 3.0), shifted((one,), 2.0))(small_arm(1))
    corrected, faults = correct_clocks(late, specimen())
    assert [fault.columns for fault in faults] == [("pressures",), (one,)]
    assert correct_clocks(corrected, specimen())[1] == ()


def test_sensors_with_clocks_of_their_own_are_moved_each_by_its_own():
    late = both(shifted(("bend_tip",), 2.0), shifted(("frame_tip",), 3.0))(small_arm(0))
    _, faults = correct_clocks(late, specimen())
    found = {fault.columns[0]: float(fault.what.split()[2]) for fault in faults}
    assert found == {"bend_tip": pytest.approx(2.0, abs=0.2), "frame_tip": pytest.approx(3.0, abs=0.2)}
