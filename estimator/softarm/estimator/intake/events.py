"""Stretches of a recording that no steady law explains: a touch, a violent start, a body found elsewhere.

Each second of each stream is compared with what the law predicts from all other times (``law.left_out``). Its
error follows a Student-t distribution of the predicted variance under the law, and a far wider normal one
during an event; whether an event lasts is a Markov chain of two states (Rabiner, Proc. IEEE 77 (1989) 257). A
law of the arm's own state may err as widely where the state is new, such as the first time under a load, and
there alike while the state rests; a hand comes and goes in any state. Of the two the likelier explains a
stretch. One that only a touch explains is reported when it is large enough to move a fit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaln, logsumexp

from softarm.estimator.arrays import Flags, Floats, Indices
from softarm.estimator.intake.grid import Grid, grid_of
from softarm.estimator.intake.law import (
    CORRELATION,
    START,
    Predictors,
    fit_variances,
    left_out,
    open_law,
    own_noise,
    precision,
    stretch_left_out,
)
from softarm.estimator.intake.provoked import slopes_of, unprovoked_motion
from softarm.estimator.intake.relocated import losses, relocation
from softarm.estimator.intake.result import Disturbance
from softarm.estimator.intake.streams import SampledStream, streams_of
from softarm.estimator.recording import Recording
from softarm.estimator.series import joined
from softarm.estimator.specimen import Specimen

SHORTEST = 20.0
"""Shorter recordings [s] hold too little of any law to tell an event from it."""
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
PRESSED = 2e3
"""Pressures that never change by this [Pa] have no law."""
TAUT = 0.02
"""A gauge that pulls harder [N] is a known force, and no event."""
GUARD = 0.5
"""What is left out on either side of an event [s]."""
NEAR = 2.0
"""Events closer than this [s] are one."""
LASTING = 4
"""Rows of ``FINEST`` seconds that unprovoked motion lasts: one at a pressure step is late motion."""
LOST = 0.05
"""A body that was lost for so long [s] may be found elsewhere."""
TOUCH = 15.0
"""Moments of unprovoked motion closer than this [s] begin and end one touch."""
ALIKE = 0.8
"""Share of an event's size that a pressure must explain to be called equivalent."""


Touches = dict[int, list[tuple[float, float]]]
"""Stretches [s] in which something acts on a stream, or its body reads elsewhere, by the stream's number."""


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


def find_events(recording: Recording, specimen: Specimen) -> tuple[Disturbance, ...]:
    """Find the stretches of a recording that no steady law explains.

    Nothing is looked for in recordings that are short, in which no pressure changes or nothing moves.

    Args:
        recording: What was recorded, in the right units and on one clock.
        specimen: The robot, whose lengths turn bends into displacements.
    """
    streams = streams_of(recording, specimen)
    if not _has_law(recording, streams):
        return ()
    touched = _touches(recording, streams)
    fit = law_errors(recording, streams, touched)
    if fit is None:
        return ()
    if elsewhere := _relocated(recording, streams, fit):
        touched |= elsewhere
        fit = law_errors(recording, streams, touched) or fit
    numbers = np.unique(fit.grid.stream)
    chances = np.array([_probability(fit, fit.grid.stream == k) for k in numbers])
    for first, beyond in _stretches(chances.max(axis=0), 1.0 - PROBABLE):
        rows = np.flatnonzero((fit.seconds >= first) & (fit.seconds < beyond))
        if len(rows) and _touched_odds(fit, rows) < np.log(PROBABLE / (1.0 - PROBABLE)):
            chances[:, first:beyond] = 0.0
    for row, number in enumerate(numbers):
        for begin, end in touched[int(number)]:
            first, last = (int(np.clip(t - fit.grid.time[0], 0, chances.shape[1] - 1)) for t in (begin, end))
            chances[row, first : last + 1] = 1.0
    events = (
        _event(recording, specimen, streams, fit, chances, begin, end)
        for begin, end in _stretches(chances.max(axis=0))
    )
    return tuple(event for event in events if event is not None)


def least_sizes(units: Sequence[str], ranges: Floats) -> Floats:
    """Return the size of an error above which it moves a fit.

    Args:
        units: Unit of each value.
        ranges: Range of each value, shape (values,).
    """
    return np.maximum([LEAST[unit] for unit in units], LEAST_SHARE * ranges)


def _has_law(recording: Recording, streams: tuple[SampledStream, ...]) -> bool:
    """Whether a recording is long enough, moves, and has pressures that change."""
    seconds = float(np.ptp(recording.time)) if len(recording.time) > 1 else 0.0
    pressures = [recording.pressure(k)[0] for k in recording.chambers]
    changes = [float(np.ptp(p[np.isfinite(p)])) for p in pressures if np.isfinite(p).any()]
    return (
        seconds >= SHORTEST and any(s.moving.any() for s in streams) and max(changes, default=0.0) >= PRESSED
    )


def _touches(recording: Recording, streams: tuple[SampledStream, ...]) -> Touches:
    """Find the stretches between motions that nothing provoked, of each moving stream."""
    fine = grid_of(recording, streams, FINEST)
    motion = unprovoked_motion(fine)
    ranges = np.ptp(np.nanpercentile(fine.values, [2.0, 98.0], axis=0), axis=0)
    large = motion.excess > least_sizes(fine.units, ranges)
    large &= ~_near(_pulled(recording, fine)[: len(large)], round(2.0 / FINEST))[:, None]
    numbers = [int(k) for k in np.unique(fine.stream)]
    found: Touches = {}
    for k in numbers:
        times = _runs(np.asarray(large[:, fine.stream == k].any(axis=1)), motion.time)
        found[k] = _between(times)
    return found


def _relocated(recording: Recording, streams: tuple[SampledStream, ...], fit: HeldOutErrors) -> Touches:
    """Find the stretches in which a stream reads with an offset, since it was lost."""
    grid = fit.grid
    relocated: Touches = {}
    for k in np.unique(grid.stream).tolist():
        moments = losses(recording.time, streams[k].values, LOST)
        columns = np.flatnonzero(grid.stream == k)
        values, spreads = grid.values[np.ix_(fit.rows, columns)], fit.spreads[columns]
        least = np.array([LEAST[grid.units[index]] for index in columns])
        shift = relocation(
            grid.time[fit.rows],
            fit.precision,
            (values - np.median(values, axis=0)) / spreads,
            moments,
            least / spreads,
        )
        if shift is not None:
            relocated[k] = [_shorter_side(recording.time, shift)]
    return relocated


def _shorter_side(time: Floats, moment: float) -> tuple[float, float]:
    """Return the part of a recording before or after a moment, the shorter of them."""
    first, last = float(time[0]), float(time[-1])
    return (moment, last) if last - moment < moment - first else (first, moment)


def _near(flags: Flags, width: int) -> Flags:
    """Widen flags by some rows on either side."""
    wide: Flags = np.convolve(flags, np.ones(2 * width + 1), "same") > 0.5
    return wide


def _runs(flags: Flags, time: Floats) -> list[float]:
    """List the middles [s] of runs of at least ``LASTING`` rows; runs a second apart are one."""
    rows = np.flatnonzero(flags)
    groups = np.split(rows, np.flatnonzero(np.diff(rows) > round(1.0 / FINEST)) + 1)
    return [float(time[group].mean()) for group in groups if len(group) >= LASTING]


def _between(times: Sequence[float]) -> list[tuple[float, float]]:
    """Turn moments of unprovoked motion into stretches: those close together begin and end one touch."""
    return [(begin, end if end > begin else end + 3.0) for begin, end in joined(times, TOUCH)]


def law_errors(
    recording: Recording, streams: tuple[SampledStream, ...], touched: Touches
) -> HeldOutErrors | None:
    """Predict every second of a recording from all others.

    Args:
        recording: What was recorded.
        streams: Its motion.
        touched: Stretches that the law is not learnt from.

    Returns:
        The errors; ``None`` where too little was read.
    """
    seconds = float(np.ptp(recording.time))
    grid = grid_of(recording, streams, max(FINEST, seconds / MOST))
    free = np.isfinite(grid.values).all(axis=1) & ~_pulled(recording, grid)
    rows = np.flatnonzero(free)
    if len(rows) * grid.step < SHORTEST:
        return None
    inputs = Predictors.of(grid.time, grid.pressures).take(rows)
    spreads = np.std(grid.values[rows], axis=0)
    scaled = (grid.values[rows] - np.median(grid.values[rows], axis=0)) / spreads
    numbers = (inputs.time - grid.time[0]).astype(np.int64)
    trusted = np.ones(len(rows))
    for begin, end in (stretch for stretches in touched.values() for stretch in stretches):
        trusted[(inputs.time >= begin - GUARD) & (inputs.time <= end + GUARD)] = LEAST_WEIGHT
    errors, variances, *fitted = _robust(inputs, scaled, numbers, trusted)
    return HeldOutErrors(grid, rows, errors * spreads, variances, spreads, numbers, inputs, *fitted)


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
        for size in EVENT_SPREADS:
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
    inputs: Predictors, values: Floats, seconds: Indices, trusted: Floats
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Fit the law and the weight of each second in turn, and predict each second from the others.

    Returns:
        Errors, their variances, and the precision, the weights and the law's variances behind them.
    """
    weights, theta = trusted, START
    for _ in range(PASSES):
        used = weights
        theta = fit_variances(inputs, values, weights, theta)
        inverse, clock = precision(inputs, weights, theta), inputs.time - inputs.time[0]
        first = left_out(inverse, values, (clock // BLOCK).astype(np.int64))
        second = left_out(inverse, values, ((clock + BLOCK / 2) // BLOCK).astype(np.int64))
        inner = np.abs(clock % BLOCK - BLOCK / 2) < BLOCK / 4
        errors = np.where(inner[:, None], first[0], second[0])
        noise = own_noise(inputs, theta)
        variances = (
            np.maximum(np.where(inner, first[1], second[1]) - noise / weights, 0.0) + noise + LAW_ERROR**2
        )
        squares = _by_second(np.mean(errors**2, axis=1) / variances, seconds)
        weights = np.clip((FREEDOM + 1.0) / (FREEDOM + squares[seconds]), LEAST_WEIGHT, trusted)
    return errors, variances, inverse, used, theta


def _by_second(values: Floats, seconds: Indices) -> Floats:
    counts = np.bincount(seconds)
    sums: Floats = np.bincount(seconds, values) / np.maximum(counts, 1)
    return sums


def _pulled(recording: Recording, grid: Grid) -> Flags:
    """Find windows in which a gauge pulls, a window on either side included, shape (windows,)."""
    pulled = np.zeros(len(grid.time), dtype=bool)
    for name in recording.gauges:
        taut = np.abs(np.nan_to_num(recording.gauge(name))) > TAUT
        windows = ((recording.time[taut] - recording.time[0]) / grid.step).astype(np.int64)
        for shift in (-1, 0, 1):
            pulled[np.clip(windows + shift, 0, len(pulled) - 1)] = True
    return pulled


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
    wide = [variances + spread**2 for spread in EVENT_SPREADS]
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


def _stretches(chance: Floats, least: float = PROBABLE) -> list[tuple[int, int]]:
    """Join seconds of a chance above the least to stretches: first second and the second after the last."""
    near = joined(np.flatnonzero(chance > least).tolist(), NEAR + 1)
    return [(int(first), int(last) + 1) for first, last in near]


def _event(
    recording: Recording,
    specimen: Specimen,
    streams: Sequence[SampledStream],
    fit: HeldOutErrors,
    chances: Floats,
    begin: int,
    end: int,
) -> Disturbance | None:
    """Describe a stretch; ``None`` where it is too small to move a fit."""
    inside = (fit.seconds >= begin) & (fit.seconds < end)
    grid, numbers = fit.grid, np.unique(fit.grid.stream)
    sizes = np.percentile(np.abs(fit.errors[inside]), LARGE, axis=0)
    usual = np.sqrt(np.median(fit.errors**2, axis=0) / 0.455)
    ranges = np.ptp(np.percentile(grid.values[fit.rows], [2.0, 98.0], axis=0), axis=0)
    enough = sizes > least_sizes(grid.units, ranges)
    probable = np.isin(grid.stream, numbers[chances[:, begin:end].max(axis=1) > PROBABLE])
    if not (enough & probable).any():
        return None
    angle, length = (np.array([unit == kind for unit in grid.units]) for kind in ("rad", "m"))
    lengths = _tip_displacement(specimen, streams, fit, inside) if not length.any() else sizes[length].max()
    start = grid.time[0] - grid.step / 2
    return Disturbance(
        recording.name,
        (
            max(start + begin - GUARD, float(recording.time[0])),
            min(start + end + GUARD, float(recording.time[-1])),
        ),
        tuple(dict.fromkeys(streams[k].name for k in grid.stream[enough & probable])),
        float(sizes[angle].max(initial=0.0)),
        float(lengths),
        float(usual[angle].max(initial=0.0)),
        float(usual[length].max(initial=0.0)),
        float(chances[:, begin:end].max()),
        _equivalent(recording, fit, inside),
    )


def _tip_displacement(
    specimen: Specimen, streams: Sequence[SampledStream], fit: HeldOutErrors, inside: Flags
) -> float:
    """Turn unexplained bends into a displacement of the tip [m], angles times distances from it."""
    tip = specimen.length_m
    total = np.zeros((int(inside.sum()), 2))
    for number in np.unique(fit.grid.stream):
        columns = np.flatnonzero(fit.grid.stream == number)
        names = {section.name: section for section in specimen.sections}
        if len(columns) == 2 and (section := names.get(streams[number].target)):
            total += fit.errors[np.ix_(inside, columns)] * max(tip - section.from_m + 0.06, 0.0)
    return float(np.percentile(np.linalg.norm(total, axis=1), LARGE)) if len(total) else 0.0


def _equivalent(recording: Recording, fit: HeldOutErrors, inside: Flags) -> tuple[int, float] | None:
    """Find the chamber whose pressure would do the same, by the linear part of the law."""
    slopes = (slopes_of(fit.grid) / fit.spreads[:, None]).T
    moved = np.median(fit.errors[inside] / fit.spreads, axis=0)
    powers = (slopes**2).sum(axis=1)
    wanted = np.where(powers > 0, slopes @ moved / np.where(powers > 0, powers, 1.0), 0.0)
    remains = ((moved - wanted[:, None] * slopes) ** 2).sum(axis=1)
    remains[np.abs(wanted) > np.abs(fit.grid.pressures).max(initial=0.0)] = np.inf
    best = int(np.argmin(remains))
    if remains[best] > (1.0 - ALIKE) * float(moved @ moved):
        return None
    return recording.chambers[best], float(wanted[best])
