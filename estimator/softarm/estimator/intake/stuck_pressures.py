"""Pressure sensors that read one and the same number while their set-points change."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.recording import Recording

LEAST = 3.0
"""Shortest time [s] for which a sensor must stand still."""
ASKED = 5000.0
"""Change of a set-point [Pa] during which a pressure must not read the same throughout."""
REPEATED = 1e-9
"""Readings that differ by less [m, rad] are one number, averaged."""
SETPOINT_STD = 30.0
"""Error of a set-point [Pa] that stands in for a pressure sensor."""


@dataclass(frozen=True)
class Stuck:
    """A sensor that stands still for a while.

    Args:
        recording: In which recording.
        sensor: Its name.
        since: Time of the recording [s].
        until: Time of the recording [s].
        before: Root mean square of its error against the model [rad, or m over ``LEVER``]; of a pressure
            that of the set-point, over ``SETPOINT_STD``.
        after: The same of its motion, which is what a held reading leaves.
        samples: Number of samples.
    """

    recording: str
    sensor: str
    since: float
    until: float
    before: float
    after: float
    samples: int


def stuck_pressures(recording: Recording) -> tuple[Stuck, ...]:
    """Find pressure sensors that read one and the same number while their set-point changes.

    A valve that does not answer is something else: its sensor goes on showing noise.
    """
    stuck = []
    time = recording.time
    for chamber in recording.chambers:
        setpoint = recording.columns.get(f"pressure_cmd_{chamber}_pa")
        measured = recording.columns.get(f"pressure_{chamber}_pa")
        if setpoint is None or measured is None:
            continue
        observed = np.flatnonzero(np.isfinite(setpoint) & np.isfinite(measured))
        for part in np.split(observed, np.flatnonzero(np.diff(measured[observed]) != 0.0) + 1):
            if len(part) < 3 or time[part[-1]] - time[part[0]] < LEAST:
                continue
            # A set-point that has just changed is not answered yet.
            low, high = np.percentile(setpoint[part], [10.0, 90.0])
            if high - low < ASKED:
                continue
            error = float(np.sqrt(np.mean((setpoint[part] - measured[part]) ** 2)))
            span = float(time[part[0]]), float(time[part[-1]])
            stuck.append(
                Stuck(recording.name, f"pressure_{chamber}", *span, error / SETPOINT_STD, 1.0, len(part))
            )
    return tuple(stuck)


def without_pressures(
    recording: Recording, stuck: Sequence[Stuck], *, by_set_points: bool = False
) -> Recording:
    """Lose what stuck pressure sensors read, or put the set-points in its place."""
    columns = dict(recording.columns)
    time = recording.time
    for one in stuck:
        if one.recording == recording.name:
            during = (time >= one.since) & (time <= one.until)
            name = f"{one.sensor}_pa"
            instead = columns[name.replace("pressure_", "pressure_cmd_")] if by_set_points else np.nan
            columns[name] = np.where(during, instead, columns[name])
    return replace(recording, columns=columns)
