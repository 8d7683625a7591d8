"""Robust and correlated statistics that several estimates share."""

import numpy as np

from softarm.estimator.arrays import Floats

HUBER = 1.5
"""Size of a residual, in standard deviations, from which its loss grows linearly (P. J. Huber, Robust
Statistics, 1981); least squares on normal data would need 96 % of the samples."""
MAD_TO_STD = 1.4826
"""Standard deviation over the median absolute deviation of a normal distribution."""


def huber_loss(sizes: Floats) -> Floats:
    """Compute twice Huber's loss of residuals in standard deviations: r^2, then 2 k |r| - k^2 beyond k."""
    size = np.abs(sizes)
    return np.where(size <= HUBER, size**2, 2.0 * HUBER * size - HUBER**2)


def huber_weight(sizes: Floats) -> Floats:
    """Compute the weights with which least squares has the gradient of Huber's loss."""
    weight: Floats = np.minimum(1.0, HUBER / np.maximum(np.abs(sizes), 1e-12))
    return weight


def weighted_median(values: Floats, weights: Floats) -> float:
    """Return the value at which half of the weight is reached."""
    order = np.argsort(values)
    middle = int(np.searchsorted(np.cumsum(weights[order]), 0.5 * weights.sum()))
    return float(values[order][min(middle, len(values) - 1)])


def correlation_length(values: Floats) -> float:
    """Compute the number of consecutive samples that count as one: 1 + 2 sum of autocorrelations.

    The sum ends before the first autocorrelation that is not positive (C. J. Geyer, Statistical Science 7
    (1992) 473, initial positive sequence); lost samples (NaN) count as zero.
    """
    filled = np.nan_to_num(values)
    power, count = float(filled @ filled), len(filled)
    if count < 4 or power == 0.0:
        return 1.0
    # The transform of the zero-padded series gives all lags at once.
    size = 2 ** int(np.ceil(np.log2(2 * count)))
    spectrum = np.abs(np.fft.rfft(filled, size)) ** 2
    correlation = np.fft.irfft(spectrum)[: count // 2] / power
    # Beyond the first zero the estimates are mostly noise, and their sum does not converge.
    ends = np.flatnonzero(correlation <= 0.0)
    end = int(ends[0]) if len(ends) else len(correlation)
    return float(min(1.0 + 2.0 * correlation[1:end].sum(), count / 2))


def unexplained_share(causes: Floats, effects: Floats, least: int) -> float:
    """Return the share of the variance of some columns that a linear regression on others leaves.

    Args:
        causes: NaN where absent, shape (samples, causes).
        effects: NaN where absent, shape (samples, effects).
        least: Complete samples below which nothing counts as explained.
    """
    complete = np.isfinite(causes).all(axis=1) & np.isfinite(effects).all(axis=1)
    if complete.sum() < least:
        return 1.0
    causes, effects = (part[complete] - part[complete].mean(axis=0) for part in (causes, effects))
    residual = effects - causes @ np.linalg.lstsq(causes, effects, rcond=None)[0]
    return float((residual**2).sum()) / max(float((effects**2).sum()), 1e-12)
