"""Holds in a recording: stretches in which nothing that is asked of the arm changes, and their means."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.recording import Recording

STEADY_PA = 1.0
"""Change from sample to sample from which a command counts as moving: small steps are led slowly."""
LOOK_S = 0.5


@dataclass(frozen=True)
class Holds:
    """Means over the end of each hold.

    Args:
        run: The run they were cut from.
        time: End of each hold [s], shape (holds,).
        pressures: Recorded pressures [Pa], shape (holds, chambers).
        readings: Stacked readings, shape (holds, readings).
        loads: Known forces [N], shape (holds, loads).
    """

    run: CalibrationRun
    time: Floats
    pressures: Floats
    readings: Floats
    loads: Floats

    def __len__(self) -> int:
        return len(self.time)

    def keep(self, flags: NDArray[np.bool_]) -> "Holds":
        """Keep some holds, shape (holds,)."""
        return Holds(
            self.run, self.time[flags], self.pressures[flags], self.readings[flags], self.loads[flags]
        )


def hold_windows(recording: Recording, shortest: float = 2.0, look: float = LOOK_S) -> Floats:
    """Find where commanded pressures stay for a while, beginning and end [s] of each look, shape (looks, 2).

    Args:
        recording: What was recorded, with commanded pressures.
        shortest: Shortest hold that counts [s].
        look: Length of the window at the end of a hold [s].
    """
    names = [name for name in recording.columns if name.startswith("pressure_cmd_")]
    table = recording.stack(tuple(names)) if names else np.zeros((len(recording.time), 0))
    known = np.isfinite(table).all(axis=1)
    times, commands = recording.time[known], table[known]
    if len(times) < 2:
        return np.zeros((0, 2))
    moving = np.flatnonzero(np.abs(np.diff(commands, axis=0)).max(axis=1, initial=0.0) > STEADY_PA)
    starts = np.concatenate([[times[0]], times[moving + 1]])
    ends = np.concatenate([times[moving], [times[-1]]])
    long = ends - starts >= shortest
    return np.column_stack([ends[long] - look, ends[long]])


def means(run: CalibrationRun, windows: Floats) -> Holds:
    """Average a run over windows; a window without any complete reading is left out.

    Args:
        run: What was recorded.
        windows: Beginning and end of each [s], shape (windows, 2).
    """
    rows = []
    for begin, end in windows:
        inside = (run.time >= begin) & (run.time <= end) & np.isfinite(run.pressures).all(axis=1)
        if not inside.any():
            continue
        readings = run.readings[inside]
        seen = np.isfinite(readings)
        total = np.where(seen, readings, 0.0).sum(axis=0)
        mean = np.where(seen.any(axis=0), total / np.maximum(seen.sum(axis=0), 1), np.nan)
        loads = run.loads[inside]
        pulls = loads[np.isfinite(loads).all(axis=1)]
        pull = pulls.mean(axis=0) if len(pulls) else np.full(loads.shape[1], np.nan)
        rows.append((end, run.pressures[inside].mean(axis=0), mean, pull))
    width, readings_width, loads_width = run.pressures.shape[1], run.readings.shape[1], run.loads.shape[1]
    return Holds(
        run,
        np.array([row[0] for row in rows]),
        np.array([row[1] for row in rows]).reshape(len(rows), width),
        np.array([row[2] for row in rows]).reshape(len(rows), readings_width),
        np.array([row[3] for row in rows]).reshape(len(rows), loads_width),
    )
