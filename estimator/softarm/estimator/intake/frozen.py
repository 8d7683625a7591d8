"""Pressures that were not recorded: all read one and the same number while the arm moves there and back.

An arm whose pressures rest rings and creeps towards one pose. Its mean over the periods of a vibration goes
one way: a dissipative system does not leave its equilibrium and return to it. An arm that does was moved by
pressures that the recording lacks, or by a hand; either way no law of the recorded pressures holds meanwhile.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.intake.grid import lost_pressures, without_pressure
from softarm.estimator.intake.result import MOTION, RecordingFault
from softarm.estimator.intake.streams import SampledStream, streams_of
from softarm.estimator.recording import Recording
from softarm.estimator.series import window_means
from softarm.estimator.specimen import Specimen

SHORTEST = 5.0
"""Shorter rests of the pressures [s] are left to the search for events."""
WINDOW = 1.0
"""Windows [s] whose means hold at most a third of a vibration of 1 Hz or more."""
LEAST = {"rad": np.radians(2.0), "m": 4e-3}
"""Motion below this size leaves a fit alone, as an event of that size does."""
RETURNED = 0.5
"""Share of the motion that returns: of a vibration that decays, means hold less."""
TAUT = 0.02
"""A gauge that pulls harder [N] is a known force, which moves the arm."""


@dataclass(frozen=True)
class Motion:
    """Motion there and back of a sensor.

    Args:
        size: How far it returned, over ``LEAST``.
        words: The sensor and how far, with the unit.
        begin: First time [s] at which it is away from its usual reading by half of ``LEAST``.
        end: Last such time [s].
    """

    size: float
    words: str
    begin: float
    end: float


def frozen_pressures(
    recording: Recording, specimen: Specimen
) -> tuple[tuple[tuple[float, float], ...], tuple[RecordingFault, ...]]:
    """Find the stretches [s] in which no pressure changes and the arm moves there and back.

    Returns:
        The stretches, in which the arm is not where it usually is meanwhile, and one mismatch for each.
    """
    if not recording.chambers:
        return (), ()
    stretches, faults = [], []
    streams = streams_of(recording, specimen)
    for begin, end in _rests(recording):
        motions = [motion for stream in streams for motion in _returned(recording.time, stream, begin, end)]
        if not motions:
            continue
        since, until = min(one.begin for one in motions), max(one.end for one in motions)
        what = (
            f"from {since:.1f} to {until:.1f} s every pressure reads one and the same number while "
            f"{max(motions, key=lambda one: one.size).words} there and back"
        )
        cure = "the pressures were not recorded, or something else moved the arm: left out of every fit"
        stretches.append((since, until))
        faults.append(RecordingFault(recording.name, "lost", ("pressures",), what, cure))
    return tuple(stretches), tuple(faults)


def unread_pressures(
    recording: Recording,
) -> tuple[tuple[tuple[float, float], ...], tuple[RecordingFault, ...]]:
    """Find the stretches [s] within a recording in which a pressure was not read although the motion was.

    Returns:
        The stretches, which no fit may see, and one mismatch for each.
    """
    motion = [values for name, values in recording.columns.items() if name.startswith(MOTION)]
    seen = recording.time[np.isfinite(motion).any(axis=0)] if motion else np.zeros(0)
    chambers: dict[tuple[float, float], list[int]] = {}
    for chamber, begin, end in lost_pressures(recording):
        within = recording.time[0] < begin and end < recording.time[-1]
        if within and ((seen > begin) & (seen < end)).any():
            chambers.setdefault((begin, end), []).append(chamber)
    faults = []
    for (begin, end), lost in chambers.items():
        many = f"chambers {', '.join(map(str, lost))}" if len(lost) > 1 else f"chamber {lost[0]}"
        what = f"no pressure of {many} was read from {begin:.1f} to {end:.1f} s"
        cure = "left out of every fit and of the search for events"
        columns = tuple(f"pressure_{chamber}_pa" for chamber in lost)
        faults.append(RecordingFault(recording.name, "lost", columns, what, cure))
    return tuple(chambers), tuple(faults)


def _rests(recording: Recording) -> list[tuple[float, float]]:
    """List the stretches [s] in which no pressure or set-point changes at all, and no gauge pulls."""
    changes = np.zeros(len(recording.time), dtype=bool)
    for name, values in recording.columns.items():
        if name.startswith("pressure_"):
            observed = np.flatnonzero(np.isfinite(values))
            changes[observed[1:][np.diff(values[observed]) != 0.0]] = True
    for gauge in recording.gauges:
        changes |= np.abs(np.nan_to_num(recording.gauge(gauge))) > TAUT
    changes |= without_pressure(recording, recording.time)
    edges = [0, *np.flatnonzero(changes).tolist(), len(changes)]
    spans = [(float(recording.time[a]), float(recording.time[b - 1])) for a, b in pairwise(edges) if b > a]
    return [(begin, end) for begin, end in spans if end - begin >= SHORTEST]


def _returned(time: Floats, stream: SampledStream, begin: float, end: float) -> Iterator[Motion]:
    """Find the motion there and back of each value of a sensor in a stretch of time [s]."""
    inside = (time >= begin) & (time <= end)
    values = stream.values[inside]
    windows = ((time[inside] - begin) / WINDOW).astype(np.int64)
    averaged = window_means(values, windows, int(windows[-1]) + 1)
    for column, raw, unit in zip(averaged.T, values.T, stream.units, strict=True):
        seen = np.flatnonzero(np.isfinite(column))
        if len(seen) < 3:
            continue
        mean, least = column[seen], LEAST[unit]
        there, back = (float((np.maximum.accumulate(way) - way).max()) for way in (mean, -mean))
        size = min(there, back)
        if size < max(least, RETURNED * float(np.ptp(raw[np.isfinite(raw)]))):
            continue
        away = seen[np.abs(mean - np.median(mean)) >= 0.5 * least]
        words = f"{np.degrees(size):.1f} degrees" if unit == "rad" else f"{1e3 * size:.0f} mm"
        yield Motion(
            size / least,
            f"{stream.name} moves by {words}",
            begin + WINDOW * float(away[0]),
            min(begin + WINDOW * (float(away[-1]) + 1.0), end),
        )
