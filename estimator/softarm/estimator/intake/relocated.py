"""Bodies that were lost and found elsewhere: a reading that keeps an offset from a loss on.

With s a step at the end of a loss and C the covariance of the readings under the law of the recording, the
offset is estimated by generalised least squares: c = s C^-1 y / (s C^-1 s), of variance 1 / (s C^-1 s). A
reading that goes on after the loss as it was before shows no offset, however badly the law predicts poses
that the recording visits only once. What makes a sensor lose its body may also shake it: such seconds have
little weight in C.
"""

import numpy as np

from softarm.estimator.arrays import Floats

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
        if step.all() or not step.any():
            continue
        weighed = precision @ step
        power = float(step @ weighed)
        offset = np.abs(weighed @ values) / power
        certain = float((offset * (offset > least)).max()) * np.sqrt(power)
        if certain > best:
            best, moment = certain, float(at)
    return moment
