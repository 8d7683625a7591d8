"""The valves between set-point and measured pressure: dead time, lag, bias, gain, dead band and ceiling.

The pressure at a valve follows the set-point u as p = F(S(u(t - d))) with dead time d, the first-order lag
F of time constant tau, and the static law S(u) = p0 where u is at most the dead band, else
min((1 + g) (u - dead band) + b, ceiling). p0 is what the sensor reads while the valve is shut. d and tau come
from the changes, S from the holds.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import comb
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from softarm.estimator.arrays import Floats
from softarm.estimator.recording import Recording
from softarm.estimator.series import runs
from softarm.estimator.simulation.filters import first_order
from softarm.estimator.statistics import MAD_TO_STD

OPEN, SHUT = 500.0, 200.0
"""Set-points above the one [Pa] open a valve; it has stayed shut if less than the other came."""
SETTLED = 0.8
"""Seconds after a change at which a valve has settled; half of a short hold if its pressure then rests."""
AT_REST = 100.0
"""Pressures that change by less between the halves of what is left of a short hold rest [Pa]."""
LEAST_GAIN_STD = 1e-4
"""Least standard deviation of a gain: no pressure sensor is linear to less of its reading."""
FEW = 5
"""Samples that are averaged at least."""
LEAST_SAMPLES = 50
"""Samples with both set-point and pressure that a valve must have to be described."""
LEAST_HOLDS, LEAST_RANGE, LEAST_GAIN = 4, 10e3, 0.01
"""Holds, and range of their set-points [Pa], that determine a gain; a smaller gain is none."""
AT_CEILING = 300.0
"""Holds within so much of the highest pressure reached [Pa] may all be at a ceiling."""
BELOW_CEILING = 500.0
"""Pressures lower than a ceiling by more than this [Pa] do not meet it."""
LEAST_MISSED, LEAST_APART = 3e3, 2e3
"""A ceiling misses a set-point by more than the former [Pa], or some that differ by more than the other."""
NEAR_CHANGE, CHANGING = 1.0, 50.0
"""Seconds after a change of the set-point by more than the latter [Pa] that show the lag."""
LEAST_NEAR = 20
"""Samples that such times must hold."""
ONSET = 0.05
"""Share of a step at which a pressure has begun to answer it."""
STEP = 2000.0
"""Change of a set-point [Pa] from one sample to the next that is a step."""
LAGS = np.array([0.0, 0.01, 0.02, 0.03, 0.045, 0.06, 0.08, 0.1, 0.13, 0.17, 0.22, 0.3, 0.4, 0.55, 0.75])
LEAST_CHANGE, SUDDEN = 3000.0, 0.1
"""Set-points must change by so much [Pa] within such a time [s] to distinguish a lag from a bias."""


class Ceiling(NamedTuple):
    """A pressure that a valve does not pass.

    Args:
        pressure: [Pa]; infinite where there is none.
        chance: Probability that just the highest set-points are those missed, if they are missed for another
            reason; 0 where several different set-points end at one pressure.
    """

    pressure: float = float("inf")
    chance: float = 0.0


class Gain(NamedTuple):
    """An error that grows with the set-point.

    Args:
        value: The error over the set-point.
        std: Its standard deviation; 0 where holds do not determine it.
    """

    value: float = 0.0
    std: float = 0.0


class ValveLaw(NamedTuple):
    """What a valve settles at.

    Args:
        holds: How often a set-point below the ceiling was held for long enough to show what it settles at.
        bias: Steady error while open [Pa].
        bias_std: Standard deviation of that between holds [Pa]; 0 where there were less than two.
        gain: Error that grows with the set-point.
        deadband: Set-point up to which nothing comes [Pa].
        ceiling: Pressure that is not passed however much is asked.
        vented: Pressure that is read while the set-point is zero [Pa]; 0 where it was never held.
        vents: How often a set-point of zero was held for long enough to read that.
    """

    holds: int = 0
    bias: float = 0.0
    bias_std: float = 0.0
    gain: Gain = Gain()
    deadband: float = 0.0
    ceiling: Ceiling = Ceiling()
    vented: float = 0.0
    vents: int = 0


class Timing(NamedTuple):
    """How a valve answers changes of its set-point.

    Args:
        dead_time: From set-point to motion [s].
        lag: Time constant [s].
        std: Standard deviation of either [s]: the scatter between steps, or the time between readings.
    """

    dead_time: float = 0.0
    lag: float = 0.0
    std: float = 0.0


@dataclass(frozen=True)
class Valve:
    """What one valve does, as far as its recording shows it.

    Args:
        chamber: Index.
        timing: How it answers changes.
        timed: Whether that is known.
        law: What it settles at.
        rms: Root mean square of measured minus asked [Pa].
        noise: Standard deviation of the reading in holds [Pa].
    """

    chamber: int
    timing: Timing
    timed: bool
    law: ValveLaw
    rms: float
    noise: float


def valves_of(
    recording: Recording, ceilings: Mapping[int, Ceiling], gains: Mapping[int, Gain] | None = None
) -> tuple[Valve, ...]:
    """Describe every valve of which set-point and pressure were both recorded and that was opened.

    Args:
        recording: The recording.
        ceilings: Pressures that valves do not pass, of ``ceilings_of``, by their chambers.
        gains: Of valves, of ``gains_of``; when left out, what this recording alone shows of them.
    """
    gains = gains_of([recording], ceilings) if gains is None else gains
    return tuple(
        _valve(
            chamber, time, setpoint, measured, ceilings.get(chamber, Ceiling()), gains.get(chamber, Gain())
        )
        for chamber, time, setpoint, measured in _opened(recording)
    )


def gains_of(recordings: Sequence[Recording], ceilings: Mapping[int, Ceiling]) -> dict[int, Gain]:
    """Find the errors of valves that grow with the set-point, over all holds of some recordings of one state.

    A recording with few set-points says little of them: its steady error could be a share of these as well.

    Args:
        recordings: The recordings.
        ceilings: Pressures that valves do not pass, of ``ceilings_of``, by their chambers.
    """
    held: dict[int, list[tuple[Floats, Floats]]] = {}
    for recording in recordings:
        for chamber, *signals in _opened(recording):
            level, pressure = _holds(*signals)
            passing = _passing(level, pressure) & (pressure < _below(ceilings.get(chamber, Ceiling())))
            held.setdefault(chamber, []).append((level[passing], (pressure - level)[passing]))
    gains = {}
    for chamber, parts in held.items():
        level, error = (np.concatenate(each) for each in zip(*parts, strict=True))
        if len(level) >= LEAST_HOLDS and np.ptp(level) > LEAST_RANGE:
            coefficients, covariance = np.polyfit(level, error, 1, cov=True)
            value = float(coefficients[0])
            std = max(float(np.sqrt(covariance[0, 0])), LEAST_GAIN_STD)
            gains[chamber] = Gain(value if abs(value) > LEAST_GAIN else 0.0, std)
    return gains


def _passing(level: Floats, pressure: Floats) -> NDArray[np.bool_]:
    """Return which holds have opened a valve, shape (holds,)."""
    closed = level < 1.0
    vented = float(np.median(pressure[closed])) if closed.any() else 0.0
    return (level > OPEN) & (pressure >= vented + SHUT)


def _below(ceiling: Ceiling) -> float:
    """Return the pressure below which a ceiling bounds nothing [Pa]."""
    return ceiling.pressure - BELOW_CEILING


def ceilings_of(recordings: Sequence[Recording]) -> dict[int, Ceiling]:
    """Find the pressures that valves do not pass in any of some recordings, by their chambers."""
    opened: dict[int, list[tuple[Floats, Floats, Floats]]] = {}
    for recording in recordings:
        for chamber, time, setpoint, measured in _opened(recording):
            opened.setdefault(chamber, []).append((time, setpoint, measured))
    ceilings = {}
    for chamber, recorded in opened.items():
        holds = [_holds(*signals) for signals in recorded]
        highest = max((float(reached.max()) for _, reached in holds if len(reached)), default=np.inf)
        rests = [rest for signals in recorded for rest in _rests_below(*signals, highest)]
        levels, reached = (np.concatenate(parts) for parts in zip(*holds, *rests, strict=True))
        ceilings[chamber] = _ceiling(levels, reached)
    return {chamber: ceiling for chamber, ceiling in ceilings.items() if np.isfinite(ceiling.pressure)}


def _opened(recording: Recording) -> Iterator[tuple[int, Floats, Floats, Floats]]:
    """Yield chamber, time, set-points and pressures of each valve that was opened."""
    for chamber in recording.chambers:
        setpoint = recording.columns.get(f"pressure_cmd_{chamber}_pa")
        measured = recording.columns.get(f"pressure_{chamber}_pa")
        if setpoint is None or measured is None:
            continue
        observed = np.isfinite(setpoint) & np.isfinite(measured)
        if observed.sum() > LEAST_SAMPLES and float(setpoint[observed].max()) > OPEN:
            yield chamber, recording.time[observed], setpoint[observed], measured[observed]


def predict(valve: Valve, time: Floats, setpoint: Floats) -> Floats:
    """Return the pressure that a valve's law predicts [Pa], shape (samples,)."""
    late = np.interp(time - valve.timing.dead_time, time, setpoint)
    return first_order(time, static(late, valve.law), valve.timing.lag, ())[0]


def static(setpoint: Floats, law: ValveLaw) -> Floats:
    """Return the settled pressure for a set-point [Pa]."""
    target = np.minimum((1.0 + law.gain.value) * (setpoint - law.deadband) + law.bias, law.ceiling.pressure)
    return np.where(setpoint > max(law.deadband, OPEN), np.maximum(target, law.vented), law.vented)


def _valve(
    chamber: int, time: Floats, setpoint: Floats, measured: Floats, ceiling: Ceiling, gain: Gain
) -> Valve:
    law = _static_law(*_holds(time, setpoint, measured), ceiling, gain)
    timed = bool(np.abs(np.interp(time + SUDDEN, time, setpoint) - setpoint).max() > LEAST_CHANGE)
    timing = _timing(time, setpoint, measured, law) if timed else Timing()
    noise = MAD_TO_STD * float(np.median(np.abs(np.diff(measured)))) / np.sqrt(2.0)
    rms = float(np.sqrt(np.mean((measured - setpoint) ** 2)))
    return Valve(chamber, timing, timed, law, rms, noise)


def _holds(time: Floats, setpoint: Floats, measured: Floats) -> tuple[Floats, Floats]:
    """Return the set-point and the pressure of each hold after which a valve has settled, shape (holds,)."""
    changes = np.flatnonzero(np.abs(np.diff(setpoint)) > 1.0) + 1
    levels, reached = [], []
    for begin, end in pairwise((0, *changes, len(time))):
        if end - begin < FEW:
            continue
        run = np.arange(begin, end)
        lasted = float(time[run[-1]] - time[run[0]])
        hold = run[time[run] >= time[run[0]] + min(SETTLED, 0.5 * lasted)]
        if len(hold) < FEW or float(time[hold[-1]] - time[hold[0]]) <= 0.1:
            continue
        late = hold[time[hold] > 0.5 * (time[hold[0]] + time[hold[-1]])]
        if lasted > 2.0 * SETTLED or _drift(measured[late]) < AT_REST:
            levels.append(float(np.median(setpoint[late])))
            reached.append(float(np.mean(measured[late])))
    return np.array(levels), np.array(reached)


def _rests_below(
    time: Floats, setpoint: Floats, measured: Floats, highest: float
) -> Iterator[tuple[Floats, Floats]]:
    """Yield two set-points, and the pressure at each, where it rests while a higher set-point moves.

    A pressure that follows late is at rest only where it meets its set-point.

    Args:
        time: [s], shape (samples,).
        setpoint: Set-points [Pa], shape (samples,).
        measured: Measured pressures [Pa], shape (samples,).
        highest: Pressure that no hold surpassed [Pa].
    """
    for begin, end in runs(setpoint > highest):
        late = np.arange(begin, end)[time[begin:end] >= time[begin] + SETTLED]
        if len(late) < FEW or _drift(measured[late]) >= AT_REST:
            continue
        above = setpoint[late] > 0.5 * (setpoint[late].min() + setpoint[late].max())
        lower, upper = late[~above], late[above]
        # Between two set-points a sample may lie that no pressure has followed yet.
        if min(len(lower), len(upper)) >= FEW:
            yield (
                np.array([setpoint[lower].mean(), setpoint[upper].mean()]),
                np.array([measured[lower].mean(), measured[upper].mean()]),
            )


def _drift(measured: Floats) -> float:
    """Return by how much the mean of a pressure changes between two halves [Pa]."""
    halves = [float(half.mean()) for half in np.array_split(measured, 2) if len(half)]
    return max(halves) - min(halves)


def _static_law(level: Floats, pressure: Floats, ceiling: Ceiling, gain: Gain) -> ValveLaw:
    """Fit the settled law to the holds, each hold one point."""
    opened, closed = level > OPEN, level < 1.0
    vents, vented = int(closed.sum()), float(np.median(pressure[closed])) if closed.any() else 0.0
    if not opened.any():
        return ValveLaw(vented=vented, vents=vents)
    passing = _passing(level, pressure)
    shut = opened & ~passing
    deadband = 0.0
    if shut.any() and passing.any() and level[shut].max() < level[passing].min():
        deadband = float(level[shut].max())
    below = passing & (pressure < _below(ceiling))
    residual = (pressure - (1.0 + gain.value) * level)[below]
    if not len(residual):
        return ValveLaw(gain=gain, deadband=deadband, ceiling=ceiling, vented=vented, vents=vents)
    spread = float(np.std(residual, ddof=1)) if len(residual) > 1 else 0.0
    bias = float(np.median(residual)) + (1.0 + gain.value) * deadband
    return ValveLaw(len(residual), bias, spread, gain, deadband, ceiling, vented, vents)


def _ceiling(level: Floats, pressure: Floats) -> Ceiling:
    """Find the pressure that several different set-points do not pass, or the highest of many alone."""
    opened = level > OPEN
    level, pressure = level[opened], pressure[opened]
    if len(level) < 3:
        return Ceiling()
    highest = float(pressure.max())
    near = pressure > highest - AT_CEILING
    short = level - pressure
    if short[near].max() <= LEAST_MISSED:
        return Ceiling()
    if near.sum() >= 2 and np.ptp(level[near]) > LEAST_APART:
        return Ceiling(highest)
    # Where the valve is merely too low by some pressure, or by some share, the others are short as well.
    others = short[~near]
    if len(others) and level[near].min() > level[~near].max() and 2.0 * others.max() < short[near].min():
        return Ceiling(highest, 1.0 / comb(len(level), int(near.sum())))
    return Ceiling()


def _timing(time: Floats, setpoint: Floats, measured: Floats, law: ValveLaw) -> Timing:
    """Find the dead time at the onsets of steps, then the lag that leaves least around changes."""
    changing = np.abs(np.diff(setpoint, prepend=setpoint[0])) > CHANGING
    since = np.maximum.accumulate(np.where(changing, time, time[0] - 10.0))
    near = time - since < NEAR_CHANGE
    resolution = reading_interval(time, measured) / np.sqrt(12.0)
    if near.sum() < LEAST_NEAR:
        return Timing(std=resolution)
    onsets = _onsets(time, setpoint, measured)
    dead_time = float(np.median(onsets)) if len(onsets) else 0.0
    std = max(median_std(onsets), float(resolution))
    late = np.interp(time - dead_time, time, setpoint)
    target = static(late, law)

    def mean_square(lag: float) -> float:
        return float(np.mean((measured - first_order(time, target, lag, ())[0])[near] ** 2))

    best = int(np.argmin([mean_square(float(lag)) for lag in LAGS]))
    if best == len(LAGS) - 1:
        return Timing(dead_time, float(LAGS[-1]), std)
    bounds = (float(LAGS[max(best - 1, 0)]), float(LAGS[best + 1]))
    return Timing(dead_time, float(minimize_scalar(mean_square, bounds=bounds, method="bounded").x), std)


def reading_interval(time: Floats, measured: Floats) -> float:
    """Return the time between readings of a sensor [s], which is longer than a sample if these interpolate.

    Between two readings interpolated samples lie on a line. Of the samples around which the pressure changes,
    the fraction that lies on none is that of the readings.
    """
    change = np.diff(measured)
    moving = (change[1:] != 0.0) | (change[:-1] != 0.0)
    # Far below the resolution of any sensor, and far above the rounding of a table.
    bent = np.abs(np.diff(measured, 2)) > 1e-6 * np.ptp(measured)
    readings = float(np.mean(bent[moving])) if moving.any() else 1.0
    return float(np.median(np.diff(time))) / max(readings, 1.0 / max(len(time), 1))


def median_std(values: Floats) -> float:
    """Return the standard deviation of a median, by order statistics; 0 of fewer than two values.

    The ranks (n - sqrt(n)) / 2 and (n + sqrt(n)) / 2 of n values are one standard deviation of a binomial
    about the median's (David and Nagaraja, Order Statistics, 2003, section 7.1).
    """
    if len(values) < 2:
        return 0.0
    ranks = 0.5 + 0.5 * np.array([-1.0, 1.0]) / np.sqrt(len(values))
    low, high = np.quantile(values, ranks, method="hazen")
    return 0.5 * float(high - low)


def _onsets(time: Floats, setpoint: Floats, measured: Floats) -> Floats:
    """Return the times from steps of the set-point until the pressure answers [s], shape (steps,)."""
    onsets = []
    for k in np.flatnonzero(np.abs(np.diff(setpoint)) > STEP):
        end = int(np.searchsorted(time, time[k + 1] + 1.0))
        if end - k < 10 or np.abs(np.diff(setpoint[k + 1 : end])).max(initial=0.0) > STEP:
            continue
        answer = np.abs(measured[k + 1 : end] - measured[k])
        moved = np.flatnonzero(answer > ONSET * abs(setpoint[k + 1] - setpoint[k]))
        if len(moved):
            onsets.append(float(time[k + 1 + moved[0]] - time[k + 1]))
    return np.array(onsets)
