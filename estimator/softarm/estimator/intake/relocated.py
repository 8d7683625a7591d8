"""Bodies that were lost and found elsewhere: a reading that keeps an offset from a loss on.

With s a step at the end of a loss and C the covariance of the readings under the law of the recording, the
offset is estimated by generalised least squares: c = s C^-1 y / (s C^-1 s), of variance 1 / (s C^-1 s). It
has to show among all readings, for one that goes on after the loss as before shows none however badly the law
predicts poses that are visited once; and without those close to the loss, since what makes a sensor lose its
body also shakes it.
"""

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.intake.law import CORRELATION

AROUND = 3.0 * CORRELATION
"""Readings closer to a loss than this [s] may be shaken: three correlation times of what the law leaves."""
SURE = 5.0
"""Standard deviations of an offset; a recording has a few hundred losses at most."""


def losses(time: Floats, values: Floats, lasting: float) -> Floats:
    """List when a sensor was found again after it had been lost for some time [s].

    Args:
        time: [s], shape (samples,).
        values: NaN where lost, shape (samples, size).
        lasting: Losses that are shorter [s], or than three usual steps, do not count.
    """
    valid_time = time[np.isfinite(values).all(axis=1)]
    steps = np.diff(valid_time)
    moments: Floats = (
        valid_time[1:][steps > max(lasting, 3.0 * float(np.median(steps)))] if len(steps) else valid_time[:0]
    )
    return moments


def relocation(
    time: Floats, precision: Floats, values: Floats, moments: Floats, least: Floats
) -> float | None:
    """Find the moment [s] from which on a sensor reads with an offset; ``None`` where it never does.

    Args:
        time: [s], shape (samples,).
        precision: Inverse of the covariance of the samples under the law, shape (samples, samples).
        values: Of the sensor, over the spread that the covariance is of, shape (samples, values).
        moments: Ends of its losses [s], shape (moments,).
        least: Offsets that count, over the same spread, shape (values,).
    """
    best, moment = SURE, None
    for at in moments:
        step = (time > at).astype(np.float64)
        far = np.abs(time - at) > AROUND
        certain = min(_certain(precision, values, step, rows, least) for rows in (far, far | True))
        if certain > best:
            best, moment = certain, float(at)
    return moment


def _certain(precision: Floats, values: Floats, step: Floats, rows: Flags, least: Floats) -> float:
    """Return the largest offset that counts, over its deviation, by some of the samples."""
    if step[rows].all() or not step[rows].any():
        return 0.0
    onto = precision[np.ix_(rows, ~rows)]
    between = np.linalg.solve(precision[np.ix_(~rows, ~rows)], onto.T @ step[rows])
    weighed = precision[np.ix_(rows, rows)] @ step[rows] - onto @ between
    power = float(step[rows] @ weighed)
    offset = np.abs(weighed @ values[rows]) / power
    return float((offset * (offset > least)).max() * np.sqrt(power))
