"""What a model leaves, as a process with memory: its innovations are white where the memory is as learnt.

What no model of an arm gets right changes slowly, so that neighbouring residuals are alike. Each channel's
residual follows r_t = sum_k a_k r_(t-k) + e_t, with coefficients by least squares on stretches that a fit may
see and an order by Schwarz's criterion (Box and Jenkins, Time Series Analysis, 1970; Schwarz, Ann. Stat. 6
(1978) 461). On other stretches e_t, over its learnt standard deviation, has unit variance and no correlation
if that holds there too.

How large the innovations are changes along a recording: where the arm is driven fast they are many times what
they are where it rests. Their variance is learnt as they come and forgotten by a discount d (West and
Harrison, Bayesian Forecasting and Dynamic Models, 1997, section 10.8): given the past, e_t over the root of S
follows Student's law with n degrees of freedom, after which S <- (n S + e_t^2) / (n + 1) and n <- d (n + 1).
So no variance depends on the innovation that it judges. Standardised innovations are normal scores of this
law (Dunn and Smyth, J. Comput. Graph. Stat. 5 (1996) 236), over their root mean square where it was fitted.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.lib.stride_tricks import sliding_window_view
from scipy.optimize import minimize
from scipy.special import chdtrc, ndtri, stdtr

from softarm.estimator.arrays import Floats

LONGEST = 8
"""Most samples that a process remembers."""
SAMPLES = 20
"""Samples for each coefficient, at least."""
LAGS = 20
"""Lags of the portmanteau test."""
FIRST = (0.9, 4.0, 0.5)
"""Where the search for a discounted variance begins: d, n and S."""
BOUNDS = ((0.5, 1.0), (1.0, 1e4), (0.01, 4.0))
"""Between which each of them lies."""
CONSTANT = (1.0, 1e4, 1.0)
"""Those of a variance that hardly changes."""
LEAST = 1e-6
"""Least variance that is learnt, over that of all: a reading that stands still has none."""
TRIALS = 120
"""Most parameters that are tried."""
UNLIKELIEST = 1e-300
"""Least chance of an innovation: the normal law has no score for less."""


@dataclass(frozen=True)
class DiscountedVariance:
    """A variance that is learnt from what came before, and forgotten.

    Args:
        discount: Share d of what is known that lasts to the next sample.
        freedom: Degrees of freedom n with which the variance is known where a stretch begins.
        variance: The variance S there.
        spread: Root mean square of the scores of the innovations that it was fitted to.
    """

    discount: float
    freedom: float
    variance: float
    spread: float = 1.0

    @classmethod
    def fitted(cls, stretches: Sequence[Floats]) -> "DiscountedVariance":
        """Find that of largest likelihood, given innovations of unit variance, or a constant one.

        Args:
            stretches: NaN where lost, each of shape (samples,).
        """

        def negative(parameters: Floats) -> float:
            return -sum(_log_likelihood(one, *parameters) for one in stretches)

        found = minimize(
            negative, np.array(FIRST), method="Nelder-Mead", bounds=BOUNDS, options={"maxfev": TRIALS}
        )
        count = sum(int(np.isfinite(one).sum()) for one in stretches)
        price = 0.5 * len(CONSTANT) * np.log(max(count, 1))  # Schwarz's criterion
        gained = negative(np.array(CONSTANT)) - float(found.fun)
        plain = cls(*(found.x.tolist() if gained > price else CONSTANT))
        scores = np.concatenate([plain.scores(one) for one in stretches])
        return replace(plain, spread=float(np.sqrt(np.nanmean(scores**2))))

    def scores(self, innovations: Floats) -> Floats:
        """Return the normal score of each innovation, given those before it, shape (samples,)."""
        freedom, variance = _known(innovations, self.discount, self.freedom, self.variance)
        beyond = stdtr(freedom, -np.abs(innovations) / np.sqrt(variance))
        scores = -np.sign(innovations) * ndtri(np.maximum(beyond, UNLIKELIEST))
        return np.asarray(scores / self.spread)


@njit(cache=True, nogil=True)
def _learnt(innovation: float, discount: float, freedom: float, variance: float) -> tuple[float, float]:
    """Return the degrees of freedom and the variance that are known after an innovation."""
    variance = (freedom * variance + innovation**2) / (freedom + 1.0)
    return discount * (freedom + 1.0), max(variance, LEAST)


@njit(cache=True, nogil=True)
def _known(innovations: Floats, discount: float, freedom: float, variance: float) -> tuple[Floats, Floats]:
    """Return the degrees of freedom and the variance that are known before each innovation."""
    freedoms, variances = np.empty_like(innovations), np.empty_like(innovations)
    for k, innovation in enumerate(innovations):
        freedoms[k], variances[k] = freedom, variance
        if np.isfinite(innovation):
            freedom, variance = _learnt(innovation, discount, freedom, variance)
    return freedoms, variances


@njit(cache=True, nogil=True)
def _log_likelihood(innovations: Floats, discount: float, freedom: float, variance: float) -> float:
    """Return the logarithm of the density of innovations (Student's law)."""
    likelihood = 0.0
    for innovation in innovations:
        if np.isfinite(innovation):
            half = 0.5 * (freedom + 1.0)
            likelihood += math.lgamma(half) - math.lgamma(0.5 * freedom)
            likelihood -= 0.5 * math.log(math.pi * freedom * variance)
            likelihood -= half * math.log1p(innovation**2 / (freedom * variance))
            freedom, variance = _learnt(innovation, discount, freedom, variance)
    return likelihood


@dataclass(frozen=True)
class Autoregression:
    """An autoregressive process.

    Args:
        coefficients: Of the last samples, the latest first, shape (order,).
        deviation: Standard deviation of its innovations.
        variance: Of each of them, over the square of that.
    """

    coefficients: Floats
    deviation: float
    variance: DiscountedVariance

    @classmethod
    def fitted(cls, stretches: Sequence[Floats]) -> "Autoregression":
        """Fit a process to stretches of equally spaced samples, NaN where lost, each of shape (samples,)."""
        rows = np.concatenate([_rows(one, LONGEST) for one in stretches] or [np.zeros((0, LONGEST + 1))])
        count = len(rows)
        best: tuple[float, Floats, float] | None = None
        for order in range(min(LONGEST, count // SAMPLES) + 1):
            past, now = rows[:, LONGEST - order : LONGEST][:, ::-1], rows[:, LONGEST]
            solution = np.linalg.lstsq(past, now, rcond=None)[0]
            variance = float(np.sum((now - past @ solution) ** 2)) / max(count - order, 1)
            price = count * np.log(max(variance, 1e-300)) + order * np.log(max(count, 1))
            if best is None or price < best[0]:
                best = (price, solution, variance)
        assert best is not None
        coefficients, deviation = best[1], float(np.sqrt(best[2]))
        if deviation <= 0.0:
            return cls(coefficients, deviation, DiscountedVariance(*CONSTANT))
        unpredicted = [_unpredicted(one, coefficients) / deviation for one in stretches]
        return cls(coefficients, deviation, DiscountedVariance.fitted(unpredicted))

    def innovations(self, stretch: Floats) -> Floats:
        """Standardise what the past of a stretch does not predict, NaN where that is lost.

        A process that was fitted to what never changed has no deviation to compare with: all is NaN.
        """
        if self.deviation <= 0.0:
            return np.full(len(stretch), np.nan)
        return self.variance.scores(_unpredicted(stretch, self.coefficients) / self.deviation)


def ljung_box(stretches: Sequence[Floats]) -> tuple[float, float]:
    """Test standardised innovations for correlation.

    Stretches are tested together: products are of samples of one stretch (Ljung and Box, Biometrika 65 (1978)
    297).

    Args:
        stretches: NaN where lost, each of shape (samples,).

    Returns:
        Correlation of neighbours, and the chance of as much correlation at all lags where there is none.
    """
    power = sum(float(np.nansum(one**2)) for one in stretches)
    count = sum(int(np.isfinite(one).sum()) for one in stretches)
    if count <= LAGS or power <= 0.0:
        return 0.0, 1.0
    products = [[one[k:] * one[:-k] for one in stretches] for k in range(1, LAGS + 1)]
    correlations = np.array([sum(float(np.nansum(one)) for one in lag) for lag in products]) / power
    # No pair reaches from one stretch to the next, or across a gap: of one whole stretch there are n - k.
    pairs = np.array([sum(int(np.isfinite(one).sum()) for one in lag) for lag in products])
    statistic = count * (count + 2) * float(np.sum(correlations**2 / np.maximum(pairs, 1)))
    return float(np.clip(correlations[0], -1.0, 1.0)), float(chdtrc(LAGS, statistic))


def _unpredicted(stretch: Floats, coefficients: Floats) -> Floats:
    """Return what the samples before it do not predict of each, of a stretch from the first whole row on."""
    order = len(coefficients)
    rows = sliding_window_view(stretch, order + 1) if len(stretch) > order else np.zeros((0, order + 1))
    return np.asarray(rows[:, -1] - rows[:, :-1] @ coefficients[::-1])


def _rows(stretch: Floats, order: int) -> Floats:
    """List each sample behind those before it, whole rows only, shape (rows, order + 1)."""
    if len(stretch) <= order:
        return np.zeros((0, order + 1))
    rows = sliding_window_view(stretch, order + 1)
    whole: Floats = rows[np.isfinite(rows).all(axis=1)]
    return whole
