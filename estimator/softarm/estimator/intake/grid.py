"""A recording at an even, slow pace: what the search for events and the comparison of clocks look at."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.intake.streams import SampledStream
from softarm.estimator.recording import Recording
from softarm.estimator.series import window_means


@dataclass(frozen=True)
class Grid:
    """Means over even windows of time.

    Args:
        time: Middle of each window [s], shape (windows,).
        step: Length of a window [s].
        pressures: Gauge pressures of the recorded chambers [Pa], shape (windows, chambers).
        values: Moving values of all streams, NaN where none was read, shape (windows, values).
        stream: Index of the stream of each value, shape (values,).
        units: Unit of each value.
    """

    time: Floats
    step: float
    pressures: Floats
    values: Floats
    stream: NDArray[np.int64]
    units: tuple[str, ...]


def pressures_of(recording: Recording) -> Floats:
    """Stack the pressures of the recorded chambers [Pa], short losses bridged, shape (samples, chambers)."""
    columns = [_bridged(recording.time, recording.pressure(k)[0]) for k in recording.chambers]
    return np.column_stack(columns) if columns else np.zeros((len(recording.time), 0))


def grid_of(recording: Recording, streams: tuple[SampledStream, ...], step: float) -> Grid:
    """Average a recording over windows of ``step`` seconds.

    Args:
        recording: What was recorded.
        streams: Its motion.
        step: Length of a window [s].
    """
    edges = np.floor((recording.time - recording.time[0]) / step + 1e-9).astype(np.int64)
    count = int(edges[-1]) + 1
    moving = [stream.moving for stream in streams]
    none = np.zeros((len(recording.time), 0))
    values = np.column_stack([none, *(s.values[:, flags] for s, flags in zip(streams, moving, strict=True))])
    numbers = [np.full(int(flags.sum()), k) for k, flags in enumerate(moving)]
    units = [
        unit
        for s, flags in zip(streams, moving, strict=True)
        for unit, keep in zip(s.units, flags, strict=True)
        if keep
    ]
    return Grid(
        recording.time[0] + (np.arange(count) + 0.5) * step,
        step,
        _filled(window_means(pressures_of(recording), edges, count)),
        window_means(values, edges, count),
        np.concatenate([*numbers, np.zeros(0, dtype=np.int64)]).astype(np.int64),
        tuple(units),
    )


def _filled(columns: Floats) -> Floats:
    """Bridge windows without a reading."""
    filled = columns.copy()
    for column in filled.T:
        valid = np.isfinite(column)
        if valid.any():
            column[~valid] = np.interp(np.flatnonzero(~valid), np.flatnonzero(valid), column[valid])
        else:
            column[:] = 0.0
    return filled


def _bridged(time: Floats, values: Floats) -> Floats:
    valid = np.isfinite(values)
    return np.interp(time, time[valid], values[valid]) if valid.any() else np.zeros(len(time))
