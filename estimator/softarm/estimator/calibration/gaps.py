"""Readings of streams that do not share their times, brought to common ones."""

import numpy as np

from softarm.estimator.arrays import Floats

LONGEST_BRIDGE = 0.25  # s; over a longer gap nothing is known


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
