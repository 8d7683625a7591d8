"""Seconds that no steady law of the pressures explains, in readings or in what a model leaves of them.

Each second of each stream is compared with what the law predicts from all other times (``law.left_out``). Its
error follows a Student-t distribution of the predicted variance under the law, and a far wider normal one
during an event; whether an event lasts is a Markov chain of two states (Rabiner, Proc. IEEE 77 (1989) 257). A
law of the arm's own state may err as widely where the state is new, such as the first time under a load, and
there alike while the state rests; a hand comes and goes in any state. Of the two the likelier explains a
stretch.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaln, logsumexp

from softarm.estimator.arrays import Flags, Floats, Indices
from softarm.estimator.intake.grid import Grid
from softarm.estimator.intake.law import (
    CORRELATION,
    START,
    Predictors,
    fit_variances,
    left_out,
    open_law,
    precision,
    sensor_noise,
    stretch_left_out,
)
from softarm.estimator.series import joined
from softarm.estimator.statistics import MAD_TO_STD

SHORTEST = 20.0
"""Shorter recordings [s] hold too little of any law to distinguish an event from it."""
MOST = 600
"""Windows of a recording at most."""
FINEST = 0.1
"""Shortest window [s]."""
BLOCK = 4.0
"""Length of the blocks that are predicted from all other times [s]."""
PASSES = 3
LEAST_WEIGHT = 1e-3
FREEDOM = 4.0
"""Degrees of freedom of the law's errors (Student-t): heavy tails, finite variance."""
LAW_ERROR = 0.03
"""The law's own error over the spread of a value, at least."""
EVENT_SPREADS = (0.1, 0.3, 1.0)
"""Standard deviations of an event over the spread of a value, equally probable."""
ENTER, LEAVE = 1.0 / 300.0, 1.0 / 3.0
"""Probability per second that an event begins, and that it ends: one in five minutes, of three seconds."""
PROBABLE = 0.95
LEAST = {"rad": np.radians(2.0), "m": 4e-3}
"""Events below this size in every unit leave a fit alone."""
LEAST_SHARE = 0.08
"""So do events below this share of the range of a value."""
LARGE = 90.0
"""Percentile of the errors within a stretch that counts as its size."""
GUARD = 0.5
"""What is left out on either side of an event [s]."""
NEAR = 2.0
"""Events closer than this [s] are one."""


@dataclass(frozen=True)
class HeldOutErrors:
    """What a law leaves of each window, from predictions that have not seen it.

    Args:
        grid: The windows.
        rows: Windows in which everything was read, shape (rows,).
        errors: Measured minus predicted, in the units of the values, shape (rows, values).
        variances: Their variance over the squared spread of a value, shape (rows,).
        spreads: Spread of each value, shape (values,).
        seconds: Number of the second of each row, shape (rows,).
        inputs: What the law may depend on, at the rows.
        precision: Inverse of the covariance of the rows over the squared spreads, shape (rows, rows).
        weights: Of the rows, shape (rows,).
        theta: Logarithms of the variances of the law's parts, shape (parts,).
        sizes_of_events: Standard deviations of an event over the spread of a value, equally probable.
    """

    grid: Grid
    rows: Indices
    errors: Floats
    variances: Floats
    spreads: Floats
    seconds: Indices
    inputs: Predictors
    precision: Floats
    weights: Floats
    theta: Floats
    sizes_of_events: tuple[float, ...]

    @property
    def numbers(self) -> Indices:
        """Numbers of the streams, shape (streams,)."""
        return np.unique(self.grid.stream)

    @property
    def usual(self) -> Floats:
        """Root mean square of the law's errors outside of events, shape (values,)."""
        usual: Floats = MAD_TO_STD * np.median(np.abs(self.errors), axis=0)
        return usual

    def chances(self) -> Floats:
        """Compute the probability of an event in each second of each stream, shape (streams, seconds).

        Seconds are left out in which a law of the arm's own state may do what nothing else does.
        """
        chances = np.array([_probability(self, self.grid.stream == k) for k in self.numbers])
        for first, beyond in stretches(chances.max(axis=0), 1.0 - PROBABLE):
            rows = np.flatnonzero((self.seconds >= first) & (self.seconds < beyond))
            if len(rows) and _touched_odds(self, rows) < np.log(PROBABLE / (1.0 - PROBABLE)):
                chances[:, first:beyond] = 0.0
        return chances


def window_of(seconds: float) -> float:
    """Return the length [s] of the windows in which a recording of some seconds is compared with a law."""
    return max(FINEST, seconds / MOST)


def ranges_of(values: Floats) -> Floats:
    """Return the range of columns, shape (columns,), without the outermost samples; NaN where lost."""
    ranges: Floats = np.ptp(np.nanpercentile(values, [2.0, 98.0], axis=0), axis=0)
    return ranges


def least_sizes(units: Sequence[str], ranges: Floats) -> Floats:
    """Return the size of an error above which it moves a fit.

    Args:
        units: Unit of each value.
        ranges: Range of each value, shape (values,).
    """
    return np.maximum([LEAST[unit] for unit in units], LEAST_SHARE * ranges)


def law_errors(
    grid: Grid,
    free: Flags,
    touched: Sequence[tuple[float, float]] = (),
    spreads: Floats | None = None,
    sizes: tuple[float, ...] = EVENT_SPREADS,
) -> HeldOutErrors | None:
    """Predict every second from all others.

    Args:
        grid: The windows.
        free: Windows that the law may explain, shape (windows,).
        touched: Stretches [s] that the law is not learnt from.
        spreads: Spread of each value outside of events; the standard deviation when left out.
        sizes: Standard deviations of an event over the spread of a value, equally probable.

    Returns:
        The errors; ``None`` where too little was read.
    """
    rows = np.flatnonzero(np.isfinite(grid.values).all(axis=1) & free)
    if len(rows) * grid.step < SHORTEST:
        return None
    inputs = Predictors.of(grid.time, grid.pressures).subset(rows)
    values = grid.values[rows] - np.median(grid.values[rows], axis=0)
    given = spreads is not None
    spreads = np.std(values, axis=0) if spreads is None else spreads
    scaled = values / spreads
    numbers = (inputs.time - grid.time[0]).astype(np.int64)
    trusted = np.ones(len(rows))
    for begin, end in touched:
        trusted[(inputs.time >= begin - GUARD) & (inputs.time <= end + GUARD)] = LEAST_WEIGHT
    # What a model leaves is near zero, so that some of it can be called unusual before any law is known.
    weights = np.minimum(trusted, _ordinary(scaled, numbers)) if given else trusted
    errors, variances, inverse, weights, theta = _robust(inputs, scaled, numbers, trusted, weights)
    return HeldOutErrors(
        grid, rows, errors * spreads, variances, spreads, numbers, inputs, inverse, weights, theta, sizes
    )


def _touched_odds(fit: HeldOutErrors, rows: Indices) -> float:
    """Compute the log odds that something touched the arm in a stretch, against a law of the arm's own state.

    Both predict the errors e that the usual law leaves there, of covariance S: a touch with S + s^2 exp(-|t -
    t'| / T), T the time that it lasts, in any state; a law with S + s^2 V, V what other times leave open of
    it (``law.open_law``). Each size s is as probable. The stream that a touch explains best counts.
    """
    values = fit.grid.values[fit.rows] / fit.spreads
    errors, usual = stretch_left_out(
        fit.inputs, fit.weights, fit.theta, fit.precision, values - np.median(values, axis=0), rows
    )
    time = fit.inputs.time[rows]
    ageing = np.abs(time[:, None] - time[None, :])
    usual += LAW_ERROR**2 * np.exp(-ageing / CORRELATION)

    def likelihoods(shape: Floats) -> Floats:
        """Return the log likelihood of each value's errors, shape (sizes, values)."""
        found = []
        for size in fit.sizes_of_events:
            factor = np.linalg.cholesky(usual + size**2 * shape)
            squares = (solve_triangular(factor, errors, lower=True) ** 2).sum(axis=0)
            found.append(-0.5 * squares - np.log(np.diag(factor)).sum())
        return np.array(found)

    touch, law = likelihoods(np.exp(-ageing * LEAVE)), likelihoods(open_law(fit.inputs, rows))
    return float(np.log(ENTER)) + max(
        float(logsumexp(touch[:, own].sum(axis=1)) - logsumexp(law[:, own].sum(axis=1)))
        for own in (fit.grid.stream == k for k in np.unique(fit.grid.stream))
    )


def _robust(
    inputs: Predictors, values: Floats, seconds: Indices, trusted: Floats, weights: Floats
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Fit the law and the weight of each second in turn, and predict each second from the others.

    Returns:
        Errors, their variances, and the precision, the weights and the law's variances behind them.
    """
    theta = START
    for _ in range(PASSES):
        used = weights
        theta = fit_variances(inputs, values, weights, theta)
        inverse, clock = precision(inputs, weights, theta), inputs.time - inputs.time[0]
        first = left_out(inverse, values, (clock // BLOCK).astype(np.int64))
        second = left_out(inverse, values, ((clock + BLOCK / 2) // BLOCK).astype(np.int64))
        inner = np.abs(clock % BLOCK - BLOCK / 2) < BLOCK / 4
        errors = np.where(inner[:, None], first[0], second[0])
        noise = sensor_noise(inputs, theta)
        variances = (
            np.maximum(np.where(inner, first[1], second[1]) - noise / weights, 0.0) + noise + LAW_ERROR**2
        )
        squares = _by_second(np.mean(errors**2, axis=1) / variances, seconds)
        weights = _weights(squares[seconds], trusted)
    return errors, variances, inverse, used, theta


def _ordinary(values: Floats, seconds: Indices) -> Floats:
    """Weigh each row by how usual it is among what a model leaves, before any law of it is known."""
    variances = (MAD_TO_STD * np.median(np.abs(values), axis=0)) ** 2 + LAW_ERROR**2
    return _weights(
        _by_second(np.mean(values**2 / variances, axis=1), seconds)[seconds], np.ones(len(seconds))
    )


def _weights(squares: Floats, most: Floats) -> Floats:
    """Return the weights of errors, given their squares over their variances (Student-t)."""
    weights: Floats = np.clip((FREEDOM + 1.0) / (FREEDOM + squares), LEAST_WEIGHT, most)
    return weights


def _by_second(values: Floats, seconds: Indices) -> Floats:
    counts = np.bincount(seconds)
    sums: Floats = np.bincount(seconds, values) / np.maximum(counts, 1)
    return sums


def _probability(fit: HeldOutErrors, columns: Flags) -> Floats:
    """Compute the probability of an event in each second of one stream, shape (seconds,)."""
    count = int(fit.seconds[-1]) + 1
    size = int(columns.sum())
    squared = np.array(  # not squared means: a swing has none
        [
            _by_second((column / spread) ** 2, fit.seconds)
            for column, spread in zip(fit.errors[:, columns].T, fit.spreads[columns], strict=True)
        ]
    )
    variances = _by_second(fit.variances, fit.seconds)
    sampled = np.bincount(fit.seconds, minlength=count) > 0
    variances = np.where(sampled, variances, 1.0)
    squares = squared.sum(axis=0)
    law = (
        gammaln((FREEDOM + size) / 2)
        - gammaln(FREEDOM / 2)
        - 0.5 * size * np.log(FREEDOM * np.pi * variances)
        - 0.5 * (FREEDOM + size) * np.log1p(squares / (FREEDOM * variances))
    )
    wide = [variances + size**2 for size in fit.sizes_of_events]
    event = logsumexp([-0.5 * size * np.log(2 * np.pi * v) - 0.5 * squares / v for v in wide], axis=0)
    return smoothed(np.where(sampled, event - np.log(len(EVENT_SPREADS)) - law, 0.0))


def smoothed(log_ratios: Floats) -> Floats:
    """Compute the posterior probability of the second state of a two-state chain (forward-backward).

    Args:
        log_ratios: Log likelihood ratio of the second state over the first, shape (steps,).
    """
    step = np.log([[1.0 - ENTER, ENTER], [LEAVE, 1.0 - LEAVE]])
    emitted = np.column_stack([np.zeros(len(log_ratios)), log_ratios])
    forward, backward = np.empty_like(emitted), np.zeros_like(emitted)
    forward[0] = emitted[0] + np.log([0.9, 0.1])  # a start is rough more often than the middle
    for k in range(1, len(emitted)):
        forward[k] = emitted[k] + np.logaddexp(*(forward[k - 1][:, None] + step))
    for k in range(len(emitted) - 2, -1, -1):
        backward[k] = np.logaddexp(*(step + emitted[k + 1] + backward[k + 1]).T)
    joint = forward + backward
    posterior: Floats = np.exp(joint[:, 1] - logsumexp(joint, axis=1))
    return posterior


def stretches(chance: Floats, least: float = PROBABLE) -> list[tuple[int, int]]:
    """Join seconds of a chance above the least to stretches: first second and the second after the last."""
    near = joined(np.flatnonzero(chance > least).tolist(), NEAR + 1)
    return [(int(first), int(last) + 1) for first, last in near]
