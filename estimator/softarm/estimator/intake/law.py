"""The steady law of a recording: its motion as a smooth function of its pressures and of what went before.

y(t) = f(p, m) + d(t) + e(t) with Gaussian-process priors (Rasmussen and Williams 2006, chapters 2 and 5):

| part | covariance | stands for |
|---|---|---|
| level | constant | where the sensor is mounted |
| linear | p . p' | bending in proportion to the pressures |
| quadratic | (p . p')^2 | chambers that push on each other, softening |
| bends of the law | exp(-|p - p'|^2 / 2 l^2) | walls, cords, saturation: anything smooth in the pressures |
| memory | m . m', m the pressures behind first-order filters | lag, creep, hysteresis |
| clock | t t' | drift, warming |
| discrepancy d | exp(-|t - t'| / 1 s) | what the law leaves, correlated in time |
| swing s | r r' exp(-|t - t'| / 1 s), r the recent rate of the pressures | inertia, valves |
| noise e | identity | |

Variances of the parts are those of largest marginal likelihood. Every second carries a weight of its own,
which divides the variance of d, s and e: a scale mixture, so that a few strange seconds do not set the law.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotri
from scipy.optimize import minimize

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.simulation.filters import recursion

FILTERS = (0.15, 0.6, 3.0, 15.0)
"""Time constants of the memory [s]: lines and inertia, slow lines, creep, slow creep."""
LENGTH = 0.35
"""Length l of the law's bends over the largest pressure."""
CORRELATION = 1.0
"""Correlation time of the discrepancy [s]."""
RECENT = 1.0
"""How long ago the pressures' changes still make the arm vibrate [s]."""
HYPER = 320
"""Samples on which the variances are fitted."""
SETTLED = 1e-6
"""Relative change of the log likelihood, of a few hundred, that ends a fit: a thousandth decides nothing."""
PARTS = ("linear", "quadratic", "smooth", "memory", "clock", "discrepancy", "swing", "noise")
START = np.log([0.5, 0.05, 0.02, 0.02, 0.002, 0.003, 0.01, 0.001])
LOWEST, HIGHEST = np.log(1e-7), np.log(30.0)
PLAY = 0.02
"""Share of the largest pressure by which noise is below the largest so far."""
KNOWN = 1e-3
"""Variance with which one sample shows a law of unit variance: noise, and a steady law's own error."""
LEVEL = 4.0
"""Variance of the level, in variances of the column."""


@dataclass(frozen=True)
class Predictors:
    """What the law may depend on, at each sample.

    Args:
        time: [s], shape (samples,).
        pressures: Over the largest, shape (samples, chambers).
        memory: Filtered minus present pressures, shape (samples, filters x chambers).
        rate: How far the pressures moved lately, over the largest, shape (samples,).
        below: How far each pressure is below its largest so far, over the largest of all, and one more, for
            the first loading of a material and all later ones are two branches of its law; shape (samples,
            chambers).
    """

    time: Floats
    pressures: Floats
    memory: Floats
    rate: Floats
    below: Floats

    @staticmethod
    def of(time: Floats, pressures: Floats) -> "Predictors":
        """Filter pressures [Pa], shape (samples, chambers), at even times."""
        scaled = pressures / max(float(np.abs(pressures).max(initial=0.0)), 1.0)
        step = float(np.median(np.diff(time)))
        memory = [first_order(scaled, step / lag) - scaled for lag in FILTERS]
        ways = np.abs(np.diff(scaled, axis=0, prepend=scaled[:1])).sum(axis=1, keepdims=True)
        rate = first_order(ways, step / RECENT) * RECENT / step
        below = np.maximum.accumulate(scaled, axis=0) - scaled
        below = np.where(below > PLAY, 1.0 + below, 0.0)
        return Predictors(time, scaled, np.column_stack(memory), np.minimum(rate[:, 0], 1.0), below)

    def subset(self, index: Indices) -> "Predictors":
        """Keep some samples."""
        return Predictors(
            self.time[index],
            self.pressures[index],
            self.memory[index],
            self.rate[index],
            self.below[index],
        )


def first_order(values: Floats, ratio: float) -> Floats:
    """Filter columns by y' = (x - y) / T, T = step / ratio, beginning at rest at the first value."""
    keep = np.exp(-ratio)
    out: Floats = recursion(np.full(len(values), keep), (1.0 - keep) * values, values[0].copy())
    return out


def covariances(inputs: Predictors, weights: Floats) -> list[Floats]:
    """Compute the covariance of each of ``PARTS`` with unit variance, shape (samples, samples) each."""
    p, time = inputs.pressures, inputs.time
    inner = p @ p.T
    middle = (time - time.mean()) / max(float(np.ptp(time)), 1e-9)
    wide = 1.0 / np.sqrt(weights)
    ageing = np.exp(-np.abs(time[:, None] - time[None, :]) / CORRELATION)
    return [
        inner,
        inner**2,
        _near(p),
        inputs.memory @ inputs.memory.T,
        np.outer(middle, middle),
        ageing * wide[:, None] * wide[None, :],
        ageing * np.outer(inputs.rate * wide, inputs.rate * wide),
        np.diag(1.0 / weights),
    ]


def _near(states: Floats) -> Floats:
    """Compute exp(-|x - x'|^2 / 2 l^2) of states x, shape (samples, samples)."""
    inner = states @ states.T
    square = np.diag(inner)
    distance = square[:, None] + square[None, :] - 2.0 * inner
    return np.asarray(np.exp(-0.5 * np.maximum(distance, 0.0) / LENGTH**2))


def open_law(inputs: Predictors, rows: Indices) -> Floats:
    """Compute the covariance that a stretch of time leaves to any smooth law of the arm's state.

    It is that of a law of unit variance, given what it is at all times outside the stretch. Where an arm is
    loaded as at no other time, or for the first time, a law may do what it does nowhere else, the same while
    the state rests; where it is as at other times, only something else can.

    Args:
        inputs: What the law may depend on.
        rows: The samples of the stretch.

    Returns:
        Shape (rows, rows).
    """
    covariance = _near(np.column_stack([inputs.pressures, inputs.below]))
    covariance[np.diag_indices_from(covariance)] += KNOWN
    inside = np.linalg.inv(_inverted(covariance)[0][np.ix_(rows, rows)])
    return np.asarray(inside - KNOWN * np.eye(len(rows)))


def fit_variances(inputs: Predictors, values: Floats, weights: Floats, start: Floats = START) -> Floats:
    """Fit the logarithms of the variances of ``PARTS`` by marginal likelihood, shape (parts,).

    Args:
        inputs: What the law may depend on.
        values: Columns of about unit variance, shape (samples, columns).
        weights: Of each sample, shape (samples,).
        start: Where the search begins.
    """
    index = np.unique(np.linspace(0, len(values) - 1, HYPER).astype(np.int64))
    parts = np.array(covariances(inputs.subset(index), weights[index]))
    y = values[index]

    def negative(theta: Floats) -> tuple[float, Floats]:
        scales = np.exp(theta)
        total = LEVEL + np.tensordot(scales, parts, 1)
        total[np.diag_indices_from(total)] += 1e-8
        inverse, half_log_determinant = _inverted(total)
        solved = inverse @ y
        columns = y.shape[1]
        value = 0.5 * float((y * solved).sum()) + columns * half_log_determinant
        inner = solved @ solved.T - columns * inverse
        return value / columns, -0.5 * scales * np.tensordot(parts, inner, 2) / columns

    bounds = [(LOWEST, HIGHEST)] * len(PARTS)
    options = {"maxiter": 30, "ftol": SETTLED}
    solution = minimize(negative, start, jac=True, bounds=bounds, method="L-BFGS-B", options=options)
    return np.asarray(solution.x, dtype=np.float64)


def precision(inputs: Predictors, weights: Floats, variances: Floats) -> Floats:
    """Compute the inverse of the samples' covariance.

    Args:
        inputs: What the law may depend on.
        weights: Of each sample, shape (samples,).
        variances: Logarithms, as ``fit_variances`` gives them.
    """
    parts = covariances(inputs, weights)
    total = LEVEL + sum(np.exp(v) * part for v, part in zip(variances, parts, strict=True))
    total[np.diag_indices_from(total)] += 1e-8
    return _inverted(total)[0]


def left_out(inverse: Floats, values: Floats, blocks: Indices) -> tuple[Floats, Floats]:
    """Predict each block of time from all others.

    With C the covariance, e_B = (C^-1_BB)^-1 (C^-1 y)_B, of covariance (C^-1_BB)^-1 (Sundararajan and
    Keerthi, Neural Computation 13 (2001) 1103, for blocks).

    Args:
        inverse: As ``precision`` gives it, shape (samples, samples).
        values: Columns, shape (samples, columns).
        blocks: Number of the block of each sample, shape (samples,).

    Returns:
        Measured minus predicted, shape (samples, columns), and the variance of it, shape (samples,).
    """
    solved = inverse @ values
    errors, spreads = np.empty_like(values), np.empty(len(values))
    for block in np.unique(blocks):
        rows = np.flatnonzero(blocks == block)
        covariance = np.linalg.inv(inverse[np.ix_(rows, rows)])
        errors[rows], spreads[rows] = covariance @ solved[rows], np.diag(covariance)
    return errors, spreads


def _inverted(covariance: Floats) -> tuple[Floats, float]:
    """Invert a positive definite matrix; also return half the logarithm of its determinant."""
    factor, failed = dpotrf(covariance.T, lower=1)  # transposed, since LAPACK counts columns first
    if failed:
        raise np.linalg.LinAlgError(f"the leading minor {failed} is not positive")
    half_log_determinant = float(np.log(np.diag(factor)).sum())
    lower, _ = dpotri(factor, lower=1, overwrite_c=1)
    whole = lower + lower.T
    whole[np.diag_indices_from(whole)] *= 0.5
    return whole, half_log_determinant


def stretch_left_out(
    inputs: Predictors, weights: Floats, variances: Floats, inverse: Floats, values: Floats, rows: Indices
) -> tuple[Floats, Floats]:
    """Predict a stretch as a whole from all other times, as ``left_out`` does.

    Args:
        inputs: What the law may depend on.
        weights: Of each sample, shape (samples,).
        variances: Logarithms, as ``fit_variances`` gives them.
        inverse: As ``precision`` gives it, shape (samples, samples).
        values: Columns, shape (samples, columns).
        rows: The samples of the stretch.

    Returns:
        Measured minus predicted, shape (rows, columns), and its covariance if the stretch had weight one,
        shape (rows, rows).
    """
    covariance = np.linalg.inv(inverse[np.ix_(rows, rows)])
    own = inputs.subset(rows)
    weighed, plain = (
        sum(
            np.exp(v) * part
            for name, v, part in zip(PARTS, variances, covariances(own, w), strict=True)
            if name in ("discrepancy", "swing", "noise")
        )
        for w in (weights[rows], np.ones(len(rows)))
    )
    sizes, axes = np.linalg.eigh(covariance - weighed)  # the law's own share, none of it negative
    return covariance @ (inverse @ values)[rows], (axes * np.maximum(sizes, 0.0)) @ axes.T + plain


def sensor_noise(inputs: Predictors, variances: Floats) -> Floats:
    """Compute the variance of what the law leaves at each sample of weight one, shape (samples,)."""
    scales = dict(zip(PARTS, np.exp(variances), strict=True))
    noise: Floats = scales["noise"] + scales["discrepancy"] + scales["swing"] * inputs.rate**2
    return noise
