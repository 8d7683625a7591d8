"""What a model leaves, as a process with memory: its innovations are white where the memory is as learnt.

What no model of an arm gets right changes slowly, so that neighbouring residuals are alike. Each channel's
residual follows r_t = sum_k a_k r_(t-k) + e_t, with coefficients by least squares on stretches that a fit may
see and an order by Schwarz's criterion (Box and Jenkins, Time Series Analysis, 1970; Schwarz, Ann. Stat. 6
(1978) 461). On other stretches e_t, over its learnt standard deviation, has unit variance and no correlation
if that holds there too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.special import chdtrc

from softarm.estimator.arrays import Floats

LONGEST = 8
"""Most samples that a process remembers."""
SAMPLES = 20
"""Samples for each coefficient, at least."""
LAGS = 20
"""Lags of the portmanteau test."""


@dataclass(frozen=True)
class Autoregression:
    """An autoregressive process.

    Args:
        coefficients: Of the last samples, the latest first, shape (order,).
        deviation: Standard deviation of its innovations.
    """

    coefficients: Floats
    deviation: float

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
        return cls(best[1], float(np.sqrt(best[2])))

    def innovations(self, stretch: Floats) -> Floats:
        """Standardise what the past of a stretch does not predict, NaN where that is lost.

        A process that was fitted to what never changed has no deviation to compare with: all is NaN.
        """
        if self.deviation <= 0.0:
            return np.full(len(stretch), np.nan)
        order = len(self.coefficients)
        rows = sliding_window_view(stretch, order + 1) if len(stretch) > order else np.zeros((0, order + 1))
        innovations: Floats = (rows[:, -1] - rows[:, :-1] @ self.coefficients[::-1]) / self.deviation
        return innovations


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
    products = [sum(float(np.nansum(one[k:] * one[:-k])) for one in stretches) for k in range(1, LAGS + 1)]
    correlations = np.array(products) / power
    statistic = count * (count + 2) * float(np.sum(correlations**2 / (count - np.arange(1, LAGS + 1))))
    return float(np.clip(correlations[0], -1.0, 1.0)), float(chdtrc(LAGS, statistic))


def _rows(stretch: Floats, order: int) -> Floats:
    """List each sample behind those before it, whole rows only, shape (rows, order + 1)."""
    if len(stretch) <= order:
        return np.zeros((0, order + 1))
    rows = sliding_window_view(stretch, order + 1)
    whole: Floats = rows[np.isfinite(rows).all(axis=1)]
    return whole
