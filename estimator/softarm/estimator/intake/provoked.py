"""Motion that nothing provoked: the arm or one sensor moves although the pressures rested.

Over half a second a reading may move by what the pressures moved meanwhile and a little before, each
times its slope, twice that for the overshoot of an undamped swing, and that swing may ring on for some
seconds:

    |y(t + h) - y(t)| <= 2 sum_k g_k (V_k * decay)(t) + noise,

with V_k the total variation of pressure k. The slope g_k is that of a regression, and at least twice the
range of the reading over that of the pressures: torsion and height follow pressures in even powers, in which
a regression sees no slope. A larger step has another cause: a touch, a jump of a body.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.intake.grid import Grid
from softarm.estimator.intake.law import first_order
from softarm.estimator.statistics import MAD_TO_STD

SPANS = (0.3, 0.5)
"""Over which motion is compared [s]: two, since a swing repeats itself over its own period."""
OVERSHOOT = 2.0
"""Largest overshoot of an undamped swing."""
RINGING = ((1.0, 1.0), (3.0, 0.15), (10.0, 0.02))
"""Decay times [s] and shares of the step that caused them: of the swing, of slow lines, of creep (a
fifth of the bend in ten seconds) over half a second."""
LATE = 0.5
"""Motion may follow the pressures late by this [s]: valves, lines, sensors."""
STEEPEST = 2.0
"""Largest slope over the mean one: a reading that follows the square of a pressure."""
RANGE = (2.0, 98.0)
"""Percentiles between which a value ranges, a few strange samples apart."""
BLIND = 3.0
"""Noise: so many robust deviations of the readings from sample to sample."""


@dataclass(frozen=True)
class UnexplainedMotion:
    """By how much each value moved beyond what the pressures provoke.

    Args:
        time: Middle of each span [s], shape (spans,).
        excess: In the units of the values, zero where provoked, shape (spans, values).
    """

    time: Floats
    excess: Floats


def unexplained_motion(grid: Grid) -> UnexplainedMotion:
    """Compare motion over short spans with that of the pressures."""
    short, long = (_over_span(grid, max(1, round(span / grid.step))) for span in SPANS)
    excess = np.maximum(long, short[: len(long)])
    return UnexplainedMotion(grid.time[: len(long)] + 0.5 * SPANS[-1], excess)


def _over_span(grid: Grid, width: int) -> Floats:
    """Compute by how much each value moves over a span beyond what is provoked, shape (spans, values)."""
    values, age = _carried(grid.values)
    slopes = _largest_slopes(grid)
    quiet = _without_noise(grid.pressures, BLIND * _noise(grid.pressures))
    way = np.abs(np.diff(quiet, axis=0, prepend=quiet[:1]))
    running = np.cumsum(way, axis=0)
    index = np.arange(len(values) - width)
    moved = np.abs(values[width:] - values[:-width])
    late = round(LATE / grid.step)
    since = np.maximum(index - late - age[:-width].T, 0).T  # the last reading before the span may be older
    meanwhile = np.einsum("tck,ck->tc", _range_sums(running, since, index + width), slopes)
    ringing = sum(
        share * (first_order(way, grid.step / time) * time / grid.step)[: len(index)] @ slopes.T
        for time, share in RINGING
    )
    noise = BLIND * _noise(grid.values)
    excess = np.maximum(moved - OVERSHOOT * (meanwhile + ringing) - noise, 0.0)
    lost = np.isnan(grid.values[width:])
    beyond: Floats = np.where(lost, 0.0, np.nan_to_num(excess))
    return beyond


def _without_noise(pressures: Floats, play: Floats) -> Floats:
    """Follow pressures with some play, as a worn gear does: noise within it adds nothing to the way."""
    followed = np.empty_like(pressures)
    state = pressures[0]
    for row, value in enumerate(pressures):
        state = np.clip(state, value - play, value + play)
        followed[row] = state
    return followed


def _range_sums(running: Floats, first: NDArray[np.int64], last: NDArray[np.int64]) -> Floats:
    """Sum ways between rows, shape (spans, values, chambers)."""
    sums: Floats = running[last][:, None, :] - running[first]
    return sums


def _carried(values: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Carry the last reading over losses; also return how many rows old it is, shapes as ``values``."""
    rows = np.arange(len(values))[:, None]
    last = np.maximum.accumulate(np.where(np.isfinite(values), rows, -1), axis=0)
    filled = np.take_along_axis(values, np.maximum(last, 0), axis=0)
    return filled, np.where(last >= 0, rows - last, 0)


def slopes_of(grid: Grid) -> Floats:
    """Regress values on pressures, shape (values, chambers)."""
    valid = np.isfinite(grid.values).all(axis=1)
    pressures, values = grid.pressures[valid], grid.values[valid]
    scale = max(float(np.abs(pressures).max(initial=0.0)), 1.0)
    design = np.column_stack([pressures / scale, np.ones(len(pressures))])
    ridge = 1e-4 * len(design) * np.eye(design.shape[1])
    solution = np.linalg.solve(design.T @ design + ridge, design.T @ (values - values.mean(axis=0)))
    slopes: Floats = solution[:-1].T / scale
    return slopes


def _largest_slopes(grid: Grid) -> Floats:
    """Bound what a pressure moves of each value, shape (values, chambers)."""
    low, high = np.nanpercentile(grid.values, RANGE, axis=0)
    largest = max(float(np.ptp(grid.pressures, axis=0).max(initial=0.0)), 1.0)
    slopes: Floats = np.maximum(np.abs(slopes_of(grid)), STEEPEST * (high - low)[:, None] / largest)
    return slopes


def _noise(values: Floats) -> Floats:
    """Return the noise of each value from second differences, shape (values,); 0 where no three follow."""
    second_differences = np.abs(np.diff(values, n=2, axis=0))
    known = np.isfinite(second_differences).any(axis=0)
    noise = np.zeros(values.shape[1])
    noise[known] = np.nanmedian(second_differences[:, known], axis=0) * MAD_TO_STD / np.sqrt(6.0)
    return noise
