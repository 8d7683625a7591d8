"""Holds in a recording: stretches in which no command to the arm changes, and their means."""

from dataclasses import replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.calibration import CalibrationRun
from softarm.estimator.calibration.nodes import mean_reading
from softarm.estimator.recording import Recording

STEADY_PA = 1.0
"""Change from sample to sample from which a command counts as moving: small steps are led slowly."""
WINDOW_S = 0.5


def hold_windows(recording: Recording, shortest: float = 2.0, window_s: float = WINDOW_S) -> Floats:
    """Find where commanded pressures stay for a while, the window at the end of each [s], shape (windows, 2).

    Args:
        recording: What was recorded, with commanded pressures.
        shortest: Shortest hold that counts [s].
        window_s: Length of the window at the end of a hold [s].
    """
    names = [name for name in recording.columns if name.startswith("pressure_cmd_")]
    table = recording.stack(tuple(names)) if names else np.zeros((len(recording.time), 0))
    valid = np.isfinite(table).all(axis=1)
    times, commands = recording.time[valid], table[valid]
    if len(times) < 2:
        return np.zeros((0, 2))
    moving = np.flatnonzero(np.abs(np.diff(commands, axis=0)).max(axis=1, initial=0.0) > STEADY_PA)
    starts = np.concatenate([[times[0]], times[moving + 1]])
    ends = np.concatenate([times[moving], [times[-1]]])
    long = ends - starts >= shortest
    return np.column_stack([ends[long] - window_s, ends[long]])


def means(run: CalibrationRun, windows: Floats) -> CalibrationRun:
    """Average a run over windows, each a sample at its end; one without complete pressures is left out.

    Args:
        run: What was recorded.
        windows: Beginning and end of each [s], shape (windows, 2).
    """
    times, pressures, readings, loads = [], [], [], []
    for begin, end in windows:
        inside = (run.time >= begin) & (run.time <= end) & np.isfinite(run.pressures).all(axis=1)
        if inside.any():
            pulled = inside & np.isfinite(run.loads).all(axis=1)
            times.append(end)
            pressures.append(run.pressures[inside].mean(axis=0))
            readings.append(mean_reading(run.readings[inside]))
            loads.append(mean_reading(run.loads[pulled]))
    return replace(
        run,
        time=np.array(times),
        pressures=np.reshape(pressures, (len(times), run.pressures.shape[1])),
        readings=np.reshape(readings, (len(times), run.readings.shape[1])),
        loads=np.reshape(loads, (len(times), run.loads.shape[1])),
    )
