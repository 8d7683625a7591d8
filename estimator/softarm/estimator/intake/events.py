"""Stretches of a recording that no steady law explains: a touch, a violent start, a body found elsewhere.

The law is that of the recording itself (``unsteady.py``). A stretch that only a touch explains is reported
when it is large enough to move a fit.
"""

from collections.abc import Sequence

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.intake.disturbances import Watched, disturbances, tip_lever
from softarm.estimator.intake.grid import Grid, grid_of
from softarm.estimator.intake.provoked import slopes_of, unexplained_motion
from softarm.estimator.intake.relocated import losses, relocation
from softarm.estimator.intake.result import Disturbance
from softarm.estimator.intake.streams import SampledStream, streams_of
from softarm.estimator.intake.unsteady import (
    FINEST,
    LEAST,
    SHORTEST,
    HeldOutErrors,
    law_errors,
    least_sizes,
    ranges_of,
    window_of,
)
from softarm.estimator.recording import Recording
from softarm.estimator.series import joined
from softarm.estimator.specimen import Specimen

PRESSED = 2e3
"""Pressures that never change by this [Pa] have no law."""
TAUT = 0.02
"""A gauge that pulls harder [N] is a known force, and no event."""
LASTING = 4
"""Rows of ``FINEST`` seconds that unprovoked motion lasts: one at a pressure step is late motion."""
LOST = 0.05
"""A body that was lost for so long [s] may be found elsewhere."""
TOUCH = 15.0
"""Moments of unprovoked motion closer than this [s] begin and end one touch."""


Touches = dict[int, list[tuple[float, float]]]
"""Stretches [s] in which something acts on a stream, or its body reads elsewhere, by the stream's number."""


def find_events(recording: Recording, specimen: Specimen) -> tuple[Disturbance, ...]:
    """Find the stretches of a recording that no steady law explains.

    Nothing is looked for in recordings that are short, in which no pressure changes or nothing moves.

    Args:
        recording: What was recorded, in the right units and on one clock.
        specimen: The robot, whose lengths convert bends into displacements.
    """
    streams = streams_of(recording, specimen)
    if not _has_law(recording, streams):
        return ()
    touched = _touches(recording, streams)
    fit = _law_errors(recording, streams, touched)
    if fit is None:
        return ()
    if elsewhere := _relocated(recording, streams, fit):
        touched |= elsewhere
        fit = _law_errors(recording, streams, touched) or fit
    chances = fit.chances()
    for row, number in enumerate(fit.numbers):
        for begin, end in touched[int(number)]:
            first, last = (int(np.clip(t - fit.grid.time[0], 0, chances.shape[1] - 1)) for t in (begin, end))
            chances[row, first : last + 1] = 1.0
    return disturbances(fit, chances, _watched(recording, specimen, streams, fit))


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
    motion = unexplained_motion(fine)
    ranges = ranges_of(fine.values)
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
    """Join moments of unprovoked motion into stretches: those close together begin and end one touch."""
    return [(begin, end if end > begin else end + 3.0) for begin, end in joined(times, TOUCH)]


def _law_errors(
    recording: Recording, streams: tuple[SampledStream, ...], touched: Touches
) -> HeldOutErrors | None:
    """Predict every second of a recording from all others; ``None`` where too little was read."""
    grid = grid_of(recording, streams, window_of(float(np.ptp(recording.time))))
    stretches = [stretch for own in touched.values() for stretch in own]
    return law_errors(grid, ~_pulled(recording, grid), stretches)


def _pulled(recording: Recording, grid: Grid) -> Flags:
    """Find windows in which a gauge pulls, a window on either side included, shape (windows,)."""
    pulled = np.zeros(len(grid.time), dtype=bool)
    for name in recording.gauges:
        taut = np.abs(np.nan_to_num(recording.gauge(name))) > TAUT
        windows = ((recording.time[taut] - recording.time[0]) / grid.step).astype(np.int64)
        for shift in (-1, 0, 1):
            pulled[np.clip(windows + shift, 0, len(pulled) - 1)] = True
    return pulled


def _watched(
    recording: Recording, specimen: Specimen, streams: Sequence[SampledStream], fit: HeldOutErrors
) -> Watched:
    """Describe the streams of a recording."""
    grid, levers = fit.grid, np.zeros((len(fit.grid.units), 2))
    sections = {section.name: section for section in specimen.sections}
    for number in fit.numbers:
        columns = np.flatnonzero(grid.stream == number)
        if len(columns) == 2 and (section := sections.get(streams[number].target)):
            levers[columns] = tip_lever(specimen, section) * np.eye(2)
    return Watched(
        recording.name,
        (float(recording.time[0]), float(recording.time[-1])),
        tuple(stream.name for stream in streams),
        ranges_of(grid.values[fit.rows]),
        levers,
        recording.chambers,
        slopes_of(grid),
    )
