"""Channels before and after, of the recordings and channels in which the findings change most."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.innovations import Residuals
from softarm.estimator.diagnosis.result import Trace
from softarm.estimator.diagnosis.session import channels

MOST = 4
POINTS = 2000


def traces_of(search: Search, before: Residuals, after: Residuals) -> tuple[Trace, ...]:
    """Return the channels that the findings change most; without findings, those that are furthest off.

    Each channel is shown once, in the recording where it changes most.

    Args:
        search: The search.
        before: Residuals of each session without the findings, shape (samples, rows).
        after: The same with them; the same object where nothing was found.
    """
    ranked: list[tuple[float, int, int]] = []
    for number, stage in enumerate(search.evidence.stages):
        if stage.session.nominal:
            continue
        scale = search.weights.stds(channels(stage.suite))
        first = np.nansum((before[number] / scale) ** 2, axis=0)
        last = np.zeros(len(scale)) if after is before else np.nansum((after[number] / scale) ** 2, axis=0)
        ranked += [(float(gain), number, row) for row, gain in enumerate((first - last).tolist())]
    chosen: dict[str, Trace] = {}
    for _, number, row in sorted(ranked, reverse=True):
        name = channels(search.evidence.stages[number].suite)[row]
        if name not in chosen and len(chosen) < MOST:
            chosen[name] = _trace(search, before[number], after[number], number, row)
    return tuple(chosen.values())


def _trace(search: Search, before: Floats, after: Floats, number: int, row: int) -> Trace:
    """Thin one row of a session out to what a picture can show."""
    stage = search.evidence.stages[number]
    session = stage.session
    reading = stage.reading_rows[:, row]
    thin = slice(None, None, max(1, session.samples // POINTS))
    return Trace(
        session.name,
        channels(stage.suite)[row],
        stage.suite.units[row],
        session.time[thin],
        reading[thin],
        (reading - before[:, row])[thin],
        (reading - after[:, row])[thin],
        session.reported[thin],
    )
