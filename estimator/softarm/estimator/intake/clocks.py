"""Clocks that do not agree: one stream shifted against the pressures by a constant, or from some time on.

For each sensor and shift, its motion is regressed on the pushes of the chambers on each segment, moved by
that shift; what counts is how well they fit, and how well each part of the run is predicted from the others.
The specimen gives the directions of the pushes: four slopes cannot follow a wrong shift, as one for every
chamber can where the poses are few. Up to ``ALLOWED`` seconds a shift is left to the calibration, or is an
effect of its own (``sensor_latency``, ``line_lag``); motion that comes earlier than its cause, or far later,
is a matter of clocks.

Levels show little of shifts that are short against the time for which a pose is held. Where all sensors lag
alike, changes over ``CHANGE`` seconds show them: pressures behind slow lines are among their causes, so what
is left to a shift is a pure delay, and one beyond ``DELAY`` is none of the arm's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.intake.grid import Grid, grid_of, pushes_of
from softarm.estimator.intake.hypotheses import UNAMBIGUOUS
from softarm.estimator.intake.law import first_order
from softarm.estimator.intake.result import MOTION, RecordingFault
from softarm.estimator.intake.streams import streams_of
from softarm.estimator.recording import Recording
from softarm.estimator.series import delayed
from softarm.estimator.specimen import Specimen
from softarm.estimator.statistics import correlation_length

ALLOWED = (-0.3, 0.7)
"""Lag of motion behind pressures [s] that is none of the clocks': as far as the calibration searches,
and as late as slow lines and sensors make it."""
LONGEST = 60.0
"""Longest shift that is looked for [s]: one system was started long after the other."""
LONGEST_SHARE = 0.3
"""And in lengths of the recording: the rest has to show it."""
STEP = 0.05
LEVELS_STEP = 0.1
"""Lags between which levels are compared [s]; the best of them is then placed to ``STEP``."""
SLOW = 0.4
"""Time constant of the slow line beside which a shift is placed [s], since the arm itself lags a little."""
EXPLAINED = 0.6
"""Share of the variance that the pressures must explain at the best shift."""
BETTER = 0.7
"""And the most of the variance left within ``ALLOWED`` that may be left there."""
FORM = 0.05
"""Share of the variance that a linear law leaves of an arm's nonlinear response at the right shift: 0.1 to
4 % in the poses and steps of simulated arms. What is left below it shows nothing about the clocks."""
SHORTEST = 10.0
APART = 1.5
"""Shifts farther apart than this [s] are different explanations."""
SPREAD = 0.25
"""Sensors whose shifts agree within this [s] share a clock."""
PRESSED = 1e3
CHANGE = 0.3
"""Time over which changes of motion and pressures are taken [s]: about a vibration, shorter than a move."""
NEARBY = 2.0
"""Time over which the power of such changes is averaged [s]."""
LAGS = (0.1, 0.4, 1.5)
"""Time constants [s] of the slow lines and of the creep that compete with a delay."""
DELAY = (-0.2, 0.3)
"""Delay of motion behind pressures [s] that valves, lines, filters of sensors and a slow swing explain."""
REACH = 2.5
"""Longest delay that is looked for in changes [s]; longer ones show in the levels."""
PARTS = 4
"""Parts of a run, each predicted from the others."""

ClockShift = tuple[float, float, float, float]
"""Lag [s] and log odds of a shift, the next best lag [s] and the log odds against that."""


@dataclass(frozen=True)
class Shifts:
    """How well each shift explains each sensor.

    Args:
        names: Sensors that the pressures explain at some shift.
        lags: By which motion lags behind the pressures [s], shape (lags,).
        likelihoods: Logarithms, by what the regression predicts of parts it has not seen, shape (sensors,
            lags).
        fitted: The same by what it fits, shape (sensors, lags).
        samples: Independent samples behind them.
        allowed: Lags from and to which are none of the clocks' [s].
    """

    names: tuple[str, ...]
    lags: Floats
    likelihoods: Floats
    fitted: Floats
    samples: float
    allowed: tuple[float, float] = ALLOWED

    @property
    def usual(self) -> NDArray[np.bool_]:
        """Lags that are none of the clocks', shape (lags,)."""
        first, last = self.allowed
        inside: NDArray[np.bool_] = (self.lags >= first - 1e-9) & (self.lags <= last + 1e-9)
        return inside


def correct_clocks(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Find streams whose clock is shifted, and shift them back where one shift wins.

    Where all sensors lag alike, the pressures are moved; else the sensor that strays.
    """
    shifts = find_shifts(recording, specimen)
    corrected, faults = _corrected_shift(recording, specimen, shifts)
    if not faults:
        return _corrected_delay(recording, specimen, shifts)
    if faults[0].corrected and faults[0].columns == ("pressures",):  # a sensor may be late besides
        corrected, more = _corrected_shift(corrected, specimen, find_shifts(corrected, specimen))
        faults = (*faults, *more)
    return corrected, faults


def _corrected_shift(
    recording: Recording, specimen: Specimen, shifts: Shifts | None
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Move the pressures where no sensor is explained without a shift, else the sensors that stray."""
    if shifts is None:
        return recording, ()

    def placed(strayed: ClockShift, *names: str) -> ClockShift:
        return _placed(recording, specimen, strayed[0], names or shifts.names), *strayed[1:]

    whole = shifts.likelihoods.mean(axis=0)
    common = _strayed(shifts, whole, shifts.fitted.mean(axis=0))
    alone = [_strayed(shifts, *own) for own in zip(shifts.likelihoods, shifts.fitted, strict=True)]
    for candidate in (common, *alone):
        if candidate is not None and _shared(shifts, candidate[0]):
            return _corrected(recording, ("pressures",), "the motion", placed(candidate))
    strayed = {name: one for name, one in zip(shifts.names, alone, strict=True) if one is not None}
    if len(strayed) == len(shifts.names):
        return _corrected(
            recording, ("pressures",), "the motion", placed(_commonest(tuple(strayed.values())))
        )
    faults: list[RecordingFault] = []
    for name, one in strayed.items():
        recording, more = _corrected(recording, (name,), name, placed(one, name))
        faults += more
    return recording, tuple(faults)


def _commonest(strayed: Sequence[ClockShift]) -> ClockShift:
    """Return the shift that most of several sensors share; of equally common ones that of the first."""
    return max(strayed, key=lambda one: sum(abs(one[0] - other[0]) < SPREAD for other in strayed))


def _corrected_delay(
    recording: Recording, specimen: Specimen, levels: Shifts | None
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Move the pressures where every sensor shows the same delay of its changes.

    That delay has to win by clear odds against the usual ones, against another far from it, and against
    pressures that explain nothing of the motion: a regression on few moves may predict worse than none.
    The levels must not speak against it: changes show no delay longer than ``REACH``.
    """
    shifts = find_delays(recording, specimen)
    if shifts is None or len(shifts.names) < 2:  # one sensor alone may be late itself
        return recording, ()
    likelihood = shifts.likelihoods.mean(axis=0)
    lag = float(shifts.lags[np.argmax(likelihood)])
    elsewhere = shifts.usual | (np.abs(shifts.lags - lag) > 2 * SPREAD)
    unrelated = float(likelihoods(np.ones(1), shifts.samples)[0])
    odds = float(likelihood.max()) - max(float(likelihood[elsewhere].max()), unrelated)
    beyond = abs(lag) > REACH - SPREAD
    refuted = any(_fits_worse(one, lag) for one in (shifts, levels) if one is not None)
    if beyond or refuted or odds < np.log(UNAMBIGUOUS) or not _shared(shifts, lag):
        return recording, ()
    return _corrected(recording, ("pressures",), "the motion", (lag, odds, lag, odds))


def _fits_worse(shifts: Shifts, lag: float) -> bool:
    """Return whether the sensors fit worse at a lag than at the best usual one."""
    fitted, near = shifts.fitted.mean(axis=0), np.abs(shifts.lags - lag) < SPREAD
    return bool(fitted[near].max() < fitted[shifts.usual].max())


def _shared(shifts: Shifts, lag: float) -> bool:
    """Return whether every sensor is explained at least as well at a lag as at any usual one."""
    near = np.abs(shifts.lags - lag) < SPREAD
    gains = shifts.likelihoods[:, near].max(axis=1) - shifts.likelihoods[:, shifts.usual].max(axis=1)
    return bool((gains > 0.0).all())


def _strayed(shifts: Shifts, likelihood: Floats, fitted: Floats) -> ClockShift | None:
    """Find a shift that clearly beats every usual one; prediction chooses it, the fit places it.

    In few poses a wrong shift may predict some from the others by chance, but only the right one fits better
    as well.

    Returns:
        Its lag [s] and log odds, the next best lag [s] and the log odds against that; ``None`` without one.
    """
    best = int(np.argmax(likelihood))
    near = np.abs(shifts.lags - shifts.lags[best]) < 2 * SPREAD
    gain = min(float(one[near].max() - one[shifts.usual].max()) for one in (likelihood, fitted))
    if shifts.usual[best] or gain < np.log(UNAMBIGUOUS) or gain < -0.5 * shifts.samples * np.log(BETTER):
        return None
    away = np.flatnonzero(np.abs(shifts.lags - shifts.lags[best]) > APART)
    leads = [float(one[near].max() - one[away].max()) for one in (likelihood, fitted)]
    other = away[np.argmax((likelihood, fitted)[int(np.argmin(leads))][away])]
    placed = np.flatnonzero(near)[np.argmax(fitted[near])]
    return float(shifts.lags[placed]), gain, float(shifts.lags[other]), min(leads)


def _corrected(
    recording: Recording, columns: tuple[str, ...], subject: str, strayed: ClockShift
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    lag, gain, other, lead = strayed
    odds = float(np.exp(min(gain, lead, 500.0)))  # beyond that the exponential overflows
    what = f"{subject} is {abs(lag):.2f} s {_way(lag)} the pressures"
    if odds < UNAMBIGUOUS:
        what += f", or {abs(other):.2f} s {_way(other)} them"
        cure = "give all streams one clock, or record a motion that does not repeat"
        return recording, (RecordingFault(recording.name, "clock", columns, what, cure, False, odds),)
    if columns == ("pressures",):
        what += ": their clocks did not start together"
        mismatch = RecordingFault(
            recording.name, "clock", columns, what, "the pressures were moved for this run", True, odds
        )
        return moved_pressures(recording, lag), (mismatch,)
    what += ", other sensors are not: its clock did not start with theirs"
    moved = {
        name: delayed(recording.time, values, -lag) if name.startswith(f"{subject}_") else values
        for name, values in recording.columns.items()
    }
    mismatch = RecordingFault(recording.name, "clock", columns, what, "moved for this run", True, odds)
    return replace(recording, columns=moved), (mismatch,)


def _way(lag: float) -> str:
    return "behind" if lag > 0 else "ahead of"


def _placed(recording: Recording, specimen: Specimen, lag: float, names: Sequence[str]) -> float:
    """Return the lag [s] near another at which pressures, also behind a slow line, fit some sensors best."""
    streams = tuple(stream for stream in streams_of(recording, specimen) if stream.name in names)
    grid = grid_of(recording, streams, _step(recording))
    levels = _levels(grid, recording, specimen)
    lags = lag + np.arange(-2 * SPREAD, 2 * SPREAD + STEP / 2, STEP)
    causes = np.column_stack([first_order(levels, grid.step / SLOW)[:, :-1], levels])
    _, fitted, _ = _unexplained(causes, grid.values, np.round(lags / grid.step).astype(np.int64))
    return float(lags[np.argmin(_of_sensor(fitted))])


def _step(recording: Recording) -> float:
    """Return the length of the windows in which levels are compared [s]."""
    return max(STEP, _seconds(recording) / 3000)


def _seconds(recording: Recording) -> float:
    """Return the length of a recording [s], which may be empty."""
    return float(np.ptp(recording.time)) if len(recording.time) > 1 else 0.0


def find_shifts(recording: Recording, specimen: Specimen) -> Shifts | None:
    """Judge every shift of every sensor by its levels; ``None`` where nothing can be determined."""
    reach = min(LONGEST, LONGEST_SHARE * _seconds(recording))
    return _judged(recording, specimen, _step(recording), reach, ALLOWED)


def find_delays(recording: Recording, specimen: Specimen) -> Shifts | None:
    """Judge every short delay of every sensor by its changes; ``None`` where nothing can be determined."""
    step = float(np.median(np.diff(recording.time))) if len(recording.time) > 1 else STEP
    return _judged(recording, specimen, max(STEP, step), REACH, DELAY, CHANGE)


def _judged(
    recording: Recording,
    specimen: Specimen,
    step: float,
    reach: float,
    allowed: tuple[float, float],
    change: float = 0.0,
) -> Shifts | None:
    """Judge shifts of up to ``reach`` by changes over some seconds, or by levels where there are none."""
    seconds, streams = _seconds(recording), streams_of(recording, specimen)
    if seconds < SHORTEST or not recording.chambers or not any(stream.moving.any() for stream in streams):
        return None
    grid = grid_of(recording, streams, step)
    if np.ptp(grid.pressures, axis=0).max(initial=0.0) < PRESSED:
        return None
    between = STEP if change else LEVELS_STEP
    lags = np.arange(-reach, reach + between / 2, between)
    causes, motion = (
        _changes(grid, max(1, round(change / grid.step)))
        if change
        else (_levels(grid, recording, specimen), grid.values)
    )
    numbers = np.unique(grid.stream)
    *left, seen = _unexplained(causes, motion, np.round(lags / grid.step).astype(np.int64))
    predicted, fitted = (
        np.array([_of_sensor(own[:, grid.stream == number]) for number in numbers]) for own in left
    )
    moved = predicted.min(axis=1) < 1.0 - (0.0 if change else EXPLAINED)
    if not moved.any():
        return None
    names = tuple(streams[number].name for number in numbers[moved])
    # Correlated neighbouring windows count once.
    independent_time = grid.step * float(
        np.mean([correlation_length(column) for column in _centred(motion).T])
    )
    samples = seconds / independent_time * (_active(motion) * _directions(motion) if change else 1.0)
    return Shifts(
        names,
        lags,
        likelihoods(predicted[moved], samples * seen),  # what has no cause left is not explained
        likelihoods(fitted[moved], samples),
        samples,
        allowed,
    )


def _levels(grid: Grid, recording: Recording, specimen: Specimen) -> Floats:
    """Return the pushes of the chambers on each segment along x and y, and one, shape (windows, causes).

    A slope for every chamber would let a few poses follow any shift.
    """
    pushes = pushes_of(grid.pressures, recording.chambers, specimen)
    pushes /= max(float(np.abs(grid.pressures).max()), 1.0)
    return np.column_stack([pushes.view(np.float64), np.ones(len(grid.time))])


def _of_sensor(left: Floats) -> Floats:
    """Average the shares that are left of a sensor's values, shape (lags, values), by their logarithms.

    A height and a torsion follow no linear law at any shift, and must not hide that all else of a pose does.
    """
    return np.asarray(np.exp(np.log(left + FORM).mean(axis=1)) - FORM)


def _changes(grid: Grid, windows: int) -> tuple[Floats, Floats]:
    """Return how pressures, as they are and behind slow lines, and the motion change over some windows.

    Both are over the root of the power of the motion nearby: a law errs in proportion to what it describes,
    and a few violent seconds must not outweigh all others.
    """
    filtered = [first_order(grid.pressures, grid.step / lag) for lag in LAGS]
    causes = np.column_stack([grid.pressures, *filtered]) / max(float(np.abs(grid.pressures).max()), 1.0)
    causes, motion = (values[windows:] - values[:-windows] for values in (causes, grid.values))
    power = np.nan_to_num(motion**2)
    nearby = np.ones(max(1, round(NEARBY / grid.step)))
    local = np.convolve((power / power.mean(axis=0)).mean(axis=1), nearby / len(nearby), "same")
    size = np.sqrt(1.0 + local)[:, None]
    return causes / size, motion / size


def _active(motion: Floats) -> float:
    """Return the share of the time in which there is motion: squared mean size over mean square."""
    power = np.nan_to_num(motion**2).sum(axis=1)
    return float(np.mean(np.sqrt(power)) ** 2 / max(float(np.mean(power)), 1e-30))


def _directions(motion: Floats) -> float:
    """Return the number of independent directions of motion: (tr C)^2 / tr C^2, C their correlations."""
    seen = motion[np.isfinite(motion).all(axis=1)]
    if len(seen) < 2:
        return 1.0
    correlations = np.nan_to_num(np.corrcoef(seen.T).reshape(seen.shape[1], -1), nan=0.0)
    return float(np.trace(correlations) ** 2 / max(float((correlations**2).sum()), 1e-30))


def _centred(values: Floats) -> Floats:
    seen = values[np.isfinite(values).all(axis=1)]
    return np.asarray(values - (seen.mean(axis=0) if len(seen) else 0.0))


def likelihoods(unexplained: Floats, samples: float | Floats) -> Floats:
    """Compute the logarithm of each shift's likelihood from the share of variance that it leaves.

    Args:
        unexplained: Shares, of any shape.
        samples: Independent samples behind them.
    """
    return np.asarray(-0.5 * samples * np.log(unexplained + FORM))


def _unexplained(causes: Floats, motion: Floats, lags: Indices) -> tuple[Floats, Floats, Floats]:
    """Compute the share of each value's variance that shifted causes leave.

    Args:
        causes: What moves the arm, shape (windows, causes).
        motion: What moves, NaN where lost, shape (windows, values).
        lags: By how many windows motion lags, shape (lags,).

    Returns:
        What they leave of each part of the run, predicted by the regression on the others, and what they
        leave in the fit, each of shape (lags, values), and the share of the windows in which both were read,
        shape (lags,). A run of ten poses has no more levels than the
        regression has coefficients: a shift by whole poses fits as well as the right one, and predicts
        nothing. Prediction is blunt about a tenth of a second, where the fit is sharp.
    """
    predicted, fitted = np.ones((2, len(lags), motion.shape[1]))
    seen = np.zeros(len(lags))
    products: list[tuple[Floats, Floats, Floats]] = []
    tried: list[int] = []
    read = np.flatnonzero(np.isfinite(motion).all(axis=1))
    motion = motion[read]
    for k, lag in enumerate(lags):
        own = slice(*np.searchsorted(read, (lag, len(causes) + lag)))
        count = own.stop - own.start
        if count < 5 * causes.shape[1]:
            continue
        seen[k] = count / len(causes)
        values, design = motion[own] - motion[own].mean(axis=0), causes[read[own] - lag]
        parts = [slice(*ends) for ends in pairwise(np.linspace(0, count, PARTS + 1).astype(int))]
        inner = np.array([design[part].T @ design[part] for part in parts])
        outer = np.array([design[part].T @ values[part] for part in parts])
        power = np.array([(values[part] ** 2).sum(axis=0) for part in parts])
        products.append((inner, outer, power))
        tried.append(k)
    if not tried:
        return predicted, fitted, seen
    inner, outer, power = (np.array(one) for one in zip(*products, strict=True))
    # Chambers that are filled alike would make the matrix singular; the ridge costs all shifts the same.
    left = _regressed(inner, outer, power, 1e-4 * len(causes) * seen[tried])
    whole = np.maximum(power.sum(axis=1), 1e-30)
    predicted[tried], fitted[tried] = (np.maximum(one, 0.0) / whole for one in left)
    return predicted, fitted, seen


def _regressed(inner: Floats, outer: Floats, power: Floats, ridge: Floats) -> tuple[Floats, Floats]:
    """Sum up what a regression mispredicts of each part from the others, and what one on all leaves.

    With A = D^T D, B = D^T V and a law L, the sum of squares of V - D L is V^T V - 2 L B + L A L.

    Args:
        inner: A of each part, shape (shifts, parts, causes, causes).
        outer: B of each part, shape (shifts, parts, causes, values).
        power: Diagonal of V^T V of each part, shape (shifts, parts, values).
        ridge: What is added to the diagonal of A, shape (shifts,).

    Returns:
        Both sums of squares, of shape (shifts, values).
    """
    added = ridge[:, None, None, None] * np.eye(inner.shape[-1])
    whole, right = inner.sum(axis=1, keepdims=True), outer.sum(axis=1, keepdims=True)
    laws = np.linalg.solve(whole - inner + added, right - outer)
    law = np.linalg.solve(whole + added, right)
    held_out: Floats = (power + (laws * (inner @ laws - 2.0 * outer)).sum(axis=2)).sum(axis=1)
    residual: Floats = power.sum(axis=1) + (law * (whole @ law - 2.0 * right)).sum(axis=2)[:, 0]
    return held_out, residual


def moved_pressures(recording: Recording, lag: float) -> Recording:
    """Move all but the motion by ``lag`` seconds: y(t) was caused by p(t - lag)."""
    columns = {
        name: values if name.startswith(MOTION) else delayed(recording.time, values, lag)
        for name, values in recording.columns.items()
    }
    return replace(recording, columns=columns)
