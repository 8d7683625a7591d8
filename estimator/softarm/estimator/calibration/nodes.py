"""Choice of the samples that a calibration rests on: short means, the quieter the heavier."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import maximum_filter1d

from softarm.estimator.arrays import Flags, Floats, Indices
from softarm.estimator.calibration.arrange import CalibrationRun

BLOCK = 10.0  # s
WINDOW = 0.1  # s over which a node's readings are averaged
PULLED_WINDOW = 0.4  # s; a gauge reads seldom and in coarse steps
REST_MARGIN = 0.3  # s of rest on either side of a node while a gauge pulls
SIGNAL = 20.0  # times its noise that a column must spread to show motion
ROUNDING = 1e-9  # of a column's size, which the spread of a constant one may come out at
NORMAL_MEAN = 1.2533  # standard deviation over mean size of a normal distribution
QUIET_SPEED = 0.5  # 1/s; motion of half its own spread per second halves a node's weight
LEAST_WEIGHT = 0.05

NEVER_SIMULTANEOUS = "pressures, motion and the forces of gauges are never measured at the same time"
RECORD_SIMULTANEOUSLY = (
    "record them at once, with marker_hook_* and the pose of its section, or gauge_direction"
)


@dataclass(frozen=True)
class Nodes:
    """Samples of one run, each the mean over a short window.

    Args:
        run: The run they come from.
        time: Middle of each window [s], shape (nodes,).
        pressures: Recorded pressures [Pa], shape (nodes, chambers).
        readings: Stacked readings, NaN where lost, shape (nodes, readings).
        loads: Known forces on the arm, three components a section [N], shape (nodes, loads).
        weights: Between ``LEAST_WEIGHT`` and 1, small where the arm moves fast, shape (nodes,).
        blocks: Which block of ``BLOCK`` seconds each belongs to, shape (nodes,).
    """

    run: CalibrationRun
    time: Floats
    pressures: Floats
    readings: Floats
    loads: Floats
    weights: Floats
    blocks: Indices

    def keep(self, flags: Flags) -> "Nodes":
        """Keep some nodes, shape (nodes,)."""
        return Nodes(
            self.run,
            self.time[flags],
            self.pressures[flags],
            self.readings[flags],
            self.loads[flags],
            self.weights[flags],
            self.blocks[flags],
        )


def choose_nodes(run: CalibrationRun, count: int) -> Nodes:
    """Choose at most ``count`` windows of a run and average each.

    They are evenly spaced; while a gauge pulls, each is moved to where hook and arm rest the most around it:
    the tension of a moving cord is not that of an equilibrium.
    """
    window = PULLED_WINDOW if run.pulled else WINDOW
    duration = run.time[-1] - run.time[0]
    number = max(1, min(count, int(duration / window)))
    speeds = _speed(run)
    centres = run.time[0] + (np.arange(number) + 0.5) * duration / number
    if run.pulled:
        centres = _resting(run, speeds, number, 0.5 * window + REST_MARGIN)
    rows, weights, kept = [], [], []
    for centre in centres:
        inside = np.abs(run.time - centre) <= window / 2
        # Pressures and loads are inputs of the model, which needs them all; any reading may be missing.
        inside &= np.isfinite(run.pressures).all(axis=1) & np.isfinite(run.loads).all(axis=1)
        if inside.any():
            kept.append(centre)
            means = (run.pressures[inside].mean(axis=0), run.loads[inside].mean(axis=0))
            rows.append((*means, mean_reading(run.readings[inside])))
            weights.append(max(1.0 / (1.0 + (speeds[inside].mean() / QUIET_SPEED) ** 2), LEAST_WEIGHT))
    time = np.array(kept)
    chambers, readings = run.pressures.shape[1], run.readings.shape[1]
    return Nodes(
        run,
        time,
        np.array([row[0] for row in rows]).reshape(len(rows), chambers),
        np.array([row[2] for row in rows]).reshape(len(rows), readings),
        np.array([row[1] for row in rows]).reshape(len(rows), run.loads.shape[1]),
        np.array(weights),
        block_of(run, time),
    )


def block_of(run: CalibrationRun, time: Floats) -> Indices:
    """Number the blocks of ``BLOCK`` seconds that times belong to."""
    blocks: Indices = ((time - run.time[0]) // BLOCK).astype(np.int64)
    return blocks


def training_blocks(blocks: Sequence[int] | Indices) -> Flags:
    """Return which blocks a fit may see: every other one."""
    training: Flags = np.asarray(blocks) % 2 == 0
    return training


def _resting(run: CalibrationRun, speeds: Floats, number: int, margin: float) -> Floats:
    """Find the moment of each of ``number`` even stretches around which the fastest motion is the slowest."""
    step = float(np.median(np.diff(run.time))) if len(run.time) > 1 else 1.0
    busiest = maximum_filter1d(speeds, 2 * max(1, round(margin / step)) + 1, mode="nearest")
    edges = run.time[0] + np.arange(number + 1) * (run.time[-1] - run.time[0]) / number
    moments = []
    for begin, end in pairwise(edges):
        inside = np.flatnonzero((run.time >= begin) & (run.time <= end))
        if len(inside):
            moments.append(run.time[inside[np.argmin(busiest[inside])]])
    return np.array(moments)


def mean_reading(readings: Floats) -> Floats:
    """Average each column over its readings, NaN where it has none, shape (columns,)."""
    observed = np.isfinite(readings)
    total = np.where(observed, readings, 0.0).sum(axis=0)
    return np.where(observed.any(axis=0), total / np.maximum(observed.sum(axis=0), 1), np.nan)


def _speed(run: CalibrationRun) -> Floats:
    """Return how fast readings and pressures move, in their own spreads per second, shape (samples,).

    Columns that hold little but noise are left out: in their own spreads, noise is fast.
    """
    columns = np.column_stack([run.readings, run.pressures])
    columns = columns[:, np.isfinite(columns).any(axis=0)]
    spread = np.nanstd(columns, axis=0)
    rounding = ROUNDING * np.nanmax(np.abs(columns), axis=0, initial=0.0)
    moving = spread > SIGNAL * _noise(columns) + rounding
    if len(run.time) < 3 or not moving.any():
        return np.zeros(len(run.time))
    smooth = _smoothed(run.time, np.nan_to_num(columns[:, moving] / spread[moving]))
    rates = np.gradient(smooth, run.time, axis=0)
    speed: Floats = np.sqrt((rates**2).mean(axis=1))
    return speed


def _noise(columns: Floats) -> Floats:
    """Return each column's standard deviation from sample to sample, by its mean second difference."""
    curvature = np.abs(np.diff(columns, n=2, axis=0))
    observed = np.isfinite(curvature)
    sizes: Floats = np.where(observed, curvature, 0.0).sum(axis=0) / np.maximum(observed.sum(axis=0), 1)
    # The second difference of white noise has 1 + 4 + 1 times its variance.
    noise: Floats = sizes * (NORMAL_MEAN / np.sqrt(6.0))
    return noise


def _smoothed(time: Floats, values: Floats) -> Floats:
    """Average over ``WINDOW`` seconds, so that noise does not count as motion."""
    width = max(1, round(WINDOW / float(np.median(np.diff(time)))))
    if width < 2 or len(time) < 3 * width:
        return values
    padded = np.pad(values, ((width // 2, width - 1 - width // 2), (0, 0)), mode="edge")
    total = np.cumsum(np.vstack([np.zeros(values.shape[1]), padded]), axis=0)
    smooth: Floats = (total[width:] - total[:-width]) / width
    return smooth
