"""When one scatter is significantly larger than another."""

import numpy as np
from scipy.special import fdtri, ndtr, stdtrit

SIGNIFICANCE = 0.01
"""Largest probability that a scatter passes its limit by chance."""
LEAST_RATIO = 1.3
"""Ratio of two scatters up to which they count as the same, however many samples they have."""
NODES_PER_FREEDOM = 4.0
"""Number of neighbouring nodes that count as one independent sample."""


def scatter_limit(freedom: float, reference: float, significance: float = SIGNIFICANCE) -> float:
    """Return the ratio of two standard deviations above which they differ (F test).

    Args:
        freedom: Independent samples of the scatter that is judged.
        reference: Independent samples of that to which it is compared.
        significance: Largest probability that the limit is passed by chance.
    """
    ratio = fdtri(max(freedom, 1.0), max(reference, 1.0), 1.0 - significance)
    return max(float(np.sqrt(ratio)), LEAST_RATIO)


def student_factor(freedom: float) -> float:
    """Return the factor on a deviation from few samples, of which twice holds 95 % by Student's t.

    Args:
        freedom: Degrees of freedom of the samples.
    """
    return float(stdtrit(freedom, ndtr(2.0))) / 2.0
