"""Time series: readings brought to common times, and stretches of samples."""

from collections.abc import Iterable, Sequence

import numpy as np

from softarm.estimator.arrays import Flags, Floats, Indices

LONGEST_BRIDGE = 0.25  # s; over a longer gap nothing is interpolated


def interpolate(wanted: Floats, time: Floats, values: Floats) -> Floats:
    """Interpolate a column, NaN where the readings on either side lie too far apart.

    Args:
        wanted: Times at which it is wanted [s], shape (wanted,).
        time: Times of the column [s], shape (samples,).
        values: The column, NaN where there is no reading, shape (samples,).
    """
    observed = np.isfinite(values)
    if not observed.any():
        return np.full(len(wanted), np.nan)
    times, readings = time[observed], values[observed]
    result = np.interp(wanted, times, readings)
    after = np.clip(np.searchsorted(times, wanted), 0, len(times) - 1)
    before = np.clip(after - 1, 0, len(times) - 1)
    nearest = np.minimum(np.abs(times[after] - wanted), np.abs(wanted - times[before]))
    return np.where(nearest > LONGEST_BRIDGE, np.nan, result)


def nearest(wanted: Floats, time: Floats, values: Floats, reach: float) -> Floats:
    """Return the reading nearest to each wanted time, NaN where it lies further than ``reach`` away.

    Args:
        wanted: Times at which it is wanted [s], shape (wanted,).
        time: Times of the column [s], shape (samples,).
        values: The column, or columns, shape (samples, ...).
        reach: Largest distance [s].
    """
    after = np.clip(np.searchsorted(time, wanted), 0, len(time) - 1)
    before = np.maximum(after - 1, 0)
    closer = np.where(np.abs(time[before] - wanted) <= np.abs(time[after] - wanted), before, after)
    near = (np.abs(time[closer] - wanted) <= reach).reshape(-1, *(1,) * (values.ndim - 1))
    return np.where(near, values[closer], np.nan)


def delayed(time: Floats, values: Floats, lag: float) -> Floats:
    """Return the nearest readings of some time before, NaN beyond the ends, shape (samples, ...).

    Args:
        time: [s], shape (samples,).
        values: Shape (samples, ...).
        lag: How long before [s]; negative for later.
    """
    return nearest(time - lag, time, values, float(np.median(np.diff(time))))


def window_means(values: Floats, windows: Indices, count: int) -> Floats:
    """Average the readings of each window, NaN where there is none, shape (windows, columns).

    Args:
        values: NaN where there is no reading, shape (samples, columns).
        windows: Window of each sample, shape (samples,).
        count: Number of windows.
    """
    means = np.full((count, values.shape[1]), np.nan)
    for index, column in enumerate(values.T):
        observed = np.isfinite(column)
        members = np.bincount(windows[observed], minlength=count)
        total = np.bincount(windows[observed], column[observed], count)
        means[members > 0, index] = total[members > 0] / members[members > 0]
    return means


def inside(time: Floats, stretches: Iterable[tuple[float, float]]) -> Flags:
    """Return which moments lie within one of some stretches [s], shape (samples,)."""
    within = np.zeros(len(time), dtype=bool)
    for begin, end in stretches:
        within |= (time >= begin) & (time <= end)
    return within


def runs(flags: Flags) -> list[tuple[int, int]]:
    """List the runs of samples at which a flag is set: the first sample, and that after the last.

    Args:
        flags: Shape (samples,).
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(first, end) for first, end in edges.reshape(-1, 2).tolist()]


def joined(moments: Sequence[float], gap: float) -> list[tuple[float, float]]:
    """Join rising moments that are no more than ``gap`` apart; list the first and the last of each group."""
    stretches: list[tuple[float, float]] = []
    for moment in moments:
        if stretches and moment - stretches[-1][1] <= gap:
            stretches[-1] = (stretches[-1][0], moment)
        else:
            stretches.append((moment, moment))
    return stretches
