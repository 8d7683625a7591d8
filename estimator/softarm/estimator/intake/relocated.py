"""Bodies that were lost and found elsewhere: a reading that keeps an offset from a loss on.

With D the pressures, their squares, the filtered pressures, the clock and a constant, and s a step at the
end of a loss, y = D a + s c + e. The part of s that D does not explain shows c and its standard deviation.
"""

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.intake.grid import Grid
from softarm.estimator.intake.law import first_order

FILTERS = (0.6, 3.0)
"""Time constants of the filtered pressures [s]."""
SHORTEST = 0.5
"""Seconds per independent sample of what the regression leaves, at least."""
SURE = 5.0
"""Standard deviations of an offset; a recording has a few hundred losses at most."""
LEAST_SHARE = 0.005
"""A step explained by the rest of the regression to all but this share shows nothing."""


def losses(time: Floats, values: Floats, lasting: float) -> Floats:
    """List when a sensor was found again after it had been lost for some time [s].

    Args:
        time: [s], shape (samples,).
        values: NaN where lost, shape (samples, size).
        lasting: Losses that are shorter [s], or than three usual steps, do not count.
    """
    seen = time[np.isfinite(values).all(axis=1)]
    steps = np.diff(seen)
    found: Floats = seen[1:][steps > max(lasting, 3.0 * float(np.median(steps)))] if len(steps) else seen[:0]
    return found


def relocation(grid: Grid, own: NDArray[np.bool_], moments: Floats, least: Floats) -> float | None:
    """Find the moment [s] from which on a sensor reads with an offset; ``None`` where it never does.

    Args:
        grid: The recording.
        own: Values of the sensor, shape (values,).
        moments: Ends of its losses [s].
        least: Offsets that count, in the units of its values, shape (own values,).
    """
    seen = np.isfinite(grid.values[:, own]).all(axis=1)
    basis = _basis(grid)[seen]
    if not len(moments) or len(basis) < 3 * basis.shape[1]:
        return None
    left, sizes, _ = np.linalg.svd(basis, full_matrices=False)
    orthonormal = left[:, sizes > 1e-6 * sizes[0]]
    values = grid.values[seen][:, own]
    residual = values - orthonormal @ (orthonormal.T @ values)
    best, moment = SURE, None
    for at in moments:
        step = (grid.time[seen] > at).astype(np.float64)
        power = float(step @ step)
        step -= orthonormal @ (orthonormal.T @ step)
        inner = float(step @ step)
        if inner <= LEAST_SHARE * power:
            continue
        offset = step @ residual / inner
        rest = residual - np.outer(step, offset)
        deviation = np.sqrt((rest**2).mean(axis=0) * _samples_per_independent(rest, grid.step) / inner)
        certain = float((np.abs(offset) / deviation * (np.abs(offset) > least)).max())
        if certain > best:
            best, moment = certain, float(at)
    return moment


def _samples_per_independent(residual: Floats, step: float) -> Floats:
    """Estimate the samples per independent one, (1 + r) / (1 - r) of a first-order process.

    What a regression leaves of a moving arm swings, so that ``statistics.correlation_length``, which ends at
    the first negative autocorrelation, is two to five times shorter and would find relocations in it.
    """
    power = np.maximum((residual**2).sum(axis=0), 1e-30)
    correlation = np.clip((residual[1:] * residual[:-1]).sum(axis=0) / power, 0.0, 0.98)
    length: Floats = np.maximum((1.0 + correlation) / (1.0 - correlation), SHORTEST / step)
    return length


def _basis(grid: Grid) -> Floats:
    scaled = grid.pressures / max(float(np.abs(grid.pressures).max(initial=0.0)), 1.0)
    filtered = [first_order(scaled, grid.step / lag) for lag in FILTERS]
    clock = (grid.time - grid.time[0]) / max(float(np.ptp(grid.time)), 1e-9)
    return np.column_stack([np.ones(len(scaled)), clock, scaled, scaled**2, *filtered])
