"""A recording at an even, slow pace: what the search for events and the comparison of clocks look at."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Complex, Flags, Floats
from softarm.estimator.intake.streams import SampledStream
from softarm.estimator.recording import Recording
from softarm.estimator.series import inside, window_means
from softarm.estimator.specimen import Specimen

LONGEST_LOSS = 1.0
"""Longest time without a reading of a pressure that is bridged [s]: a valve fills a chamber within it."""
USUAL_LOSS = 5.0
"""And in times the usual step of the readings, which may be slow ones."""


@dataclass(frozen=True)
class Grid:
    """Means over even windows of time.

    Args:
        time: Middle of each window [s], shape (windows,).
        step: Length of a window [s].
        pressures: Gauge pressures of the recorded chambers [Pa], shape (windows, chambers).
        values: Moving values of all streams, NaN where none was read or a pressure was lost for longer than
            ``LONGEST_LOSS``, shape (windows, values).
        stream: Index of the stream of each value, shape (values,).
        units: Unit of each value.
    """

    time: Floats
    step: float
    pressures: Floats
    values: Floats
    stream: NDArray[np.int64]
    units: tuple[str, ...]

    @staticmethod
    def of(
        clock: Floats,
        pressures: Floats,
        values: Floats,
        step: float,
        stream: NDArray[np.int64],
        units: tuple[str, ...],
    ) -> "Grid":
        """Average samples over windows of ``step`` seconds; windows without a pressure are bridged.

        Args:
            clock: Time of each sample [s], shape (samples,).
            pressures: Of the chambers [Pa], shape (samples, chambers).
            values: NaN where lost, shape (samples, values).
            step: Length of a window [s].
            stream: Index of the stream of each value, shape (values,).
            units: Unit of each value.
        """
        windows = np.floor((clock - clock[0]) / step + 1e-9).astype(np.int64)
        count = int(windows[-1]) + 1
        time = clock[0] + (np.arange(count) + 0.5) * step
        filled = _filled(window_means(pressures, windows, count))
        return Grid(time, step, filled, window_means(values, windows, count), stream, units)


def pressures_of(recording: Recording) -> Floats:
    """Stack the pressures of the recorded chambers [Pa], short losses bridged, shape (samples, chambers)."""
    columns = [_bridged(recording.time, recording.pressure(k)[0]) for k in recording.chambers]
    return np.column_stack(columns) if columns else np.zeros((len(recording.time), 0))


def pushes_of(pressures: Floats, chambers: Sequence[int], specimen: Specimen) -> Complex:
    """Sum up how chambers bend each segment: u_s = -sum_k exp(i phi_k) p_k over the chambers of a segment s.

    Args:
        pressures: Of the recorded chambers [Pa], shape (samples, chambers).
        chambers: Their numbers.
        specimen: With the azimuths phi of the chambers.

    Returns:
        Real part along x, imaginary part along y [Pa]; shape (samples, segments).
    """
    columns = {segment.name: column for column, segment in enumerate(specimen.segments)}
    pushes = np.zeros((len(pressures), len(columns)), dtype=np.complex128)
    for number, pressure in zip(chambers, pressures.T, strict=True):
        chamber = specimen.chambers[number]
        pushes[:, columns[chamber.segment]] -= np.exp(1j * chamber.azimuth_rad) * pressure
    return pushes


def grid_of(recording: Recording, streams: tuple[SampledStream, ...], step: float) -> Grid:
    """Average a recording over windows of ``step`` seconds.

    Args:
        recording: What was recorded.
        streams: Its motion.
        step: Length of a window [s].
    """
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
    stream = np.concatenate([*numbers, np.zeros(0, dtype=np.int64)]).astype(np.int64)
    grid = Grid.of(recording.time, pressures_of(recording), values, step, stream, tuple(units))
    grid.values[without_pressure(recording, grid.time)] = np.nan
    return grid


def without_pressure(recording: Recording, time: Floats) -> Flags:
    """Return at which times [s] some pressure was lost for long, in the shape of ``time``."""
    return inside(time, [(begin, end) for _, begin, end in lost_pressures(recording)])


def lost_pressures(recording: Recording) -> list[tuple[int, float, float]]:
    """List the stretches in which a pressure that was read at other times was lost for long.

    Returns:
        Chamber, begin and end [s] of each.
    """
    losses = []
    for chamber in recording.chambers:
        times = recording.time[np.isfinite(recording.pressure(chamber)[0])]
        if len(times) < 2:
            continue
        longest = max(LONGEST_LOSS, USUAL_LOSS * float(np.median(np.diff(times))))
        ends = np.concatenate([recording.time[:1], times, recording.time[-1:]])
        losses += [
            (chamber, float(ends[k]), float(ends[k + 1])) for k in np.flatnonzero(np.diff(ends) > longest)
        ]
    return losses


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
