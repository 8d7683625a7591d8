"""Sensors, or single axes of bends, that stand still while the pressures and the rest of the arm move.

A sensor that lives shows noise. Where one repeats a number for seconds although it shows noise at other
times, or another one shows noise meanwhile, it stands still. Where it goes on showing noise, what it should
see decides: chambers bend a section towards their azimuths a_k, so the drive v = sum_k p_k (cos a_k, sin a_k)
becomes a bend B v, with B a gain times a rotation or a reflection. Each axis shows what the other should see.
Where a bend lags or its clock is shifted, the drive at the lag that explains it best counts; at another
one it would seem to stand still in every pose that is held for hardly longer than that lag.
A body that hangs below one that moves cannot stand still, nor can a marker whose distances from the others of
its body change.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.effects import EFFECTS
from softarm.estimator.intake.bodies import rigid_bodies
from softarm.estimator.intake.grid import pressures_of, pushes_of
from softarm.estimator.intake.labels import MISFIT, PLACED
from softarm.estimator.intake.result import RecordingFault
from softarm.estimator.intake.streams import QUIET, SPREAD, SampledStream, streams_of
from softarm.estimator.intake.stuck_pressures import ASKED, LEAST, REPEATED
from softarm.estimator.recording import MARKER_SUFFIXES, Recording
from softarm.estimator.series import delayed, runs, window_means
from softarm.estimator.specimen import Specimen
from softarm.estimator.statistics import unexplained_share

WINDOW = 0.25
"""Readings are averaged over so long [s] before they are compared: most of their noise goes."""
DRIVEN = 0.5
"""Share of its range over the run that the drive covers while a reading that shows noise stands still."""
CLEAR = 10.0
"""Times ``QUIET`` by which it should move meanwhile: the gains of an arm's segments and chambers differ by
less."""
EXPLAINED = 0.6
"""Share of an axis' variance that the drive must explain for its gain to be known."""
LEAST_WINDOWS = 5
"""Windows in which both a bend and its drive were read, below which nothing is learnt of it."""
LAGS = np.arange(-2.5, 2.55, 0.05)
"""Lags of a bend behind its drive [s] that are tried; longer ones leave the gain of no axis known."""
UNEQUAL = EFFECTS["chamber_gain"].parameters[0].spread
"""Share by which the gains of chambers differ: a drive that is less of their sum may come of that."""
EXCITED = 0.2
"""Directions in which the drive moves by less than this share of its strongest show no gain."""


@dataclass(frozen=True)
class BendAxes:
    """A bend and what drives it, averaged over windows.

    Args:
        values: Both axes [rad], NaN where lost, shape (windows, 2).
        drive: v [Pa], NaN in windows where it is unknown, shape (windows, 2).
    """

    values: Floats
    drive: Floats

    def gains(self) -> list[Floats | None]:
        """Fit each axis' row of B [rad/Pa], shape (2,); ``None`` where v does not explain the axis."""
        return [_gain(self.drive, values) for values in self.values.T]

    def unexplained(self) -> float:
        """Return the share of the variance of both axes that v leaves."""
        return unexplained_share(self.drive, self.values, LEAST_WINDOWS)

    def without(self, during: slice) -> "BendAxes":
        """Lose the readings of some windows."""
        values = self.values.copy()
        values[during] = np.nan
        return replace(self, values=values)

    def wanted(self, axis: int, during: slice, bends: Sequence["BendAxes"]) -> float:
        """Predict by how much the pressures should move an axis in some windows [rad], 0 where unknown.

        The other axis predicts it; where that one stands still too, the weakest gain that a bend of the arm
        shows at other times does, along the strongest direction of the drive.
        """
        other = self.values[during, 1 - axis]
        if _spread(other) > QUIET["rad"]:
            gain = self.gains()[1 - axis]
            if gain is None:
                return 0.0
            motion = self.drive @ np.array([-gain[1], gain[0]])
        else:
            shown = [gain for bend in bends for gain in bend.without(during).gains() if gain is not None]
            shown += [gain for bend in bends if bend is not self for gain in bend.gains() if gain is not None]
            least = min((float(np.linalg.norm(gain)) for gain in shown), default=0.0)
            motion = least * self.drive @ _strongest(self.drive)
        inside = _spread(motion[during])
        return inside if inside > DRIVEN * _spread(motion) else 0.0


def _strongest(drive: Floats) -> Floats:
    """Return the direction in which the drive moves most, a unit vector of shape (2,); 0 if it is unknown."""
    sampled = drive[np.isfinite(drive).all(axis=1)]
    if not len(sampled):
        return np.zeros(2)
    direction: Floats = np.linalg.svd(sampled - sampled.mean(axis=0), full_matrices=False)[2][0]
    return direction


def _gain(drive: Floats, values: Floats) -> Floats | None:
    seen = np.isfinite(values) & np.isfinite(drive).all(axis=1)
    if seen.sum() < LEAST_WINDOWS:
        return None
    causes, effects = (part[seen] - part[seen].mean(axis=0) for part in (drive, values))
    left, sizes, right = np.linalg.svd(causes, full_matrices=False)
    known = sizes > EXCITED * sizes[0]
    gain: Floats = right[known].T @ (left[:, known].T @ effects / sizes[known])
    unexplained = float(((effects - causes @ gain) ** 2).sum())
    return gain if unexplained < (1.0 - EXPLAINED) * float((effects**2).sum()) else None


def _spread(values: Floats) -> float:
    """Return the range of most values, NaN where none was read."""
    seen = values[np.isfinite(values)]
    return float(np.ptp(np.percentile(seen, SPREAD))) if len(seen) else np.nan


@dataclass(frozen=True)
class StuckReading:
    """A sensor or one axis of it that stands still.

    Args:
        sensor: Name of the sensor.
        axis: Axis of a bend; ``None`` for all of the sensor.
        columns: What it reads.
        rows: Samples in which it stands still.
        reason: How that is known.
    """

    sensor: str
    axis: str | None
    columns: tuple[str, ...]
    rows: Indices
    reason: str

    def fault(self, recording: Recording) -> RecordingFault:
        """Name the sensor with its time and its reading."""
        since, until = (float(recording.time[k]) for k in self.rows[[0, -1]])
        values = [float(np.mean(recording.columns[name][self.rows])) for name in self.columns]
        reading = (
            " and ".join(f"{np.degrees(value):.1f}" for value in values) + " degrees"
            if self.sensor.startswith("bend_")
            else f"({', '.join(f'{1e3 * value:.0f}' for value in values[:3])}) mm"
        )
        name = f"{self.sensor}.{self.axis}" if self.axis else self.sensor
        what = f"{name} stands still at {reading} from {since:.1f} to {until:.1f} s {self.reason}"
        cure = "it is stuck and left out for that time"
        return RecordingFault(recording.name, "stuck", (name,), what, cure, interval=(since, until))


def correct_stuck(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Count as lost what sensors and axes read while they stand still, and name each."""
    faults: list[RecordingFault] = []
    for find in (_stopped, _repeated, _unmoved, _left_behind):
        columns = dict(recording.columns)
        for one in _merged(find(recording, specimen), recording.time):
            faults.append(one.fault(recording))
            for name in one.columns:
                columns[name] = columns[name].copy()
                columns[name][one.rows] = np.nan
        recording = replace(recording, columns=columns)
    lost = {
        name
        for stream in streams_of(recording, specimen)
        if faults and not np.isfinite(recording.stack(stream.columns)).any()
        for name in stream.columns
    }
    kept = {name: values for name, values in recording.columns.items() if name not in lost}
    return replace(recording, columns=kept), tuple(faults)


def _merged(found: Sequence[StuckReading], time: Floats) -> list[StuckReading]:
    """Join axes of a sensor that stand still at the same time."""
    merged: list[StuckReading] = []
    for one in sorted(found, key=lambda one: (one.sensor, one.rows[0], one.axis or "")):
        last = merged[-1] if merged else one
        apart = np.abs(time[last.rows[[0, -1]]] - time[one.rows[[0, -1]]]).max()
        if last.sensor == one.sensor and last.axis != one.axis and last.axis and apart < LEAST:
            rows = np.union1d(last.rows, one.rows)
            columns = tuple(sorted((*last.columns, *one.columns)))
            merged[-1] = replace(last, axis=None, columns=columns, rows=rows)
        else:
            merged.append(one)
    return merged


def _stopped(recording: Recording, specimen: Specimen) -> list[StuckReading]:
    """Find markers that stand still while the others of their body, whose own distances stay, move away.

    One that was never near its place in the body is a marker of another body with its name.
    """
    if len(recording.time) < 2:
        return []
    windows = _windows(recording.time)
    offsets = {marker.name: np.array(marker.offset_m) for marker in specimen.markers}
    found = []
    for names in rigid_bodies(recording, specimen):
        readings = {name: recording.marker(name) for name in names}
        places = {name: window_means(one, windows, int(windows[-1]) + 1) for name, one in readings.items()}
        for name in names:
            others = [places[other] for other in names if other != name]
            for during, seen in _quiet(recording.time, readings[name], places[name], QUIET["m"], WINDOW):
                apart = max(_stretch(other[during], places[name][during]) for other in others)
                kept = max(_stretch(a[during], b[during]) for a, b in combinations(others, 2))
                near = _off_place(name, {n: place[during] for n, place in places.items()}, offsets)
                if apart > max(QUIET["m"], CLEAR * kept) and near < MISFIT * PLACED:
                    words = f"while its distance from others of its body changes by {1e3 * apart:.1f} mm"
                    columns = tuple(f"marker_{name}_{suffix}" for suffix in MARKER_SUFFIXES)
                    found.append(StuckReading(f"marker_{name}", None, columns, seen, words))
    return found


def _off_place(name: str, places: Mapping[str, Floats], offsets: Mapping[str, Floats]) -> float:
    """Return how far a marker is from its distances to the others when it is nearest to them [m].

    Args:
        name: The marker.
        places: Of the markers of its body [m], shape (windows, 3) each.
        offsets: Their places in the specimen [m], shape (3,) each.
    """
    off = [
        np.abs(np.linalg.norm(place - places[name], axis=1) - np.linalg.norm(offsets[other] - offsets[name]))
        for other, place in places.items()
        if other != name
    ]
    largest = np.max(off, axis=0)
    return float(np.min(largest[np.isfinite(largest)], initial=np.inf))


def _stretch(one: Floats, other: Floats) -> float:
    """Return by how much the distance of two markers changes [m], 0 where they were never seen together.

    Args:
        one: Places of a marker [m], shape (windows, 3).
        other: Those of the other.
    """
    apart = np.linalg.norm(one - other, axis=1)
    return float(np.ptp(apart[np.isfinite(apart)])) if np.isfinite(apart).any() else 0.0


def _repeated(recording: Recording, specimen: Specimen) -> list[StuckReading]:
    """Find readings that repeat a number while pressures change, though readings show noise."""
    channels = [channel for stream in streams_of(recording, specimen) for channel in _channels(stream)]
    pressures = pressures_of(recording)
    return [
        StuckReading(sensor, axis, members, rows, "while other readings go on")
        for sensor, axis, members in channels
        for rows in _repeats(recording, members)
        if _pressed(pressures, rows)
        and (
            _noisy(np.delete(recording.stack(members), rows, axis=0))
            or any(_noisy(recording.stack(others)[rows]) for *_, others in channels if others != members)
        )
    ]


def _pressed(pressures: Floats, rows: Indices) -> bool:
    """Return whether a pressure changes by more than ``ASKED`` in some samples."""
    return bool(np.ptp(pressures[rows], axis=0).max(initial=0.0) > ASKED)


def _channels(stream: SampledStream) -> Iterator[tuple[str, str | None, tuple[str, ...]]]:
    """List what can stand still alone: the axes of a bend, else a body as a whole."""
    if stream.kind == "bend":
        yield from ((stream.name, axis, (c,)) for axis, c in zip("xy", stream.columns, strict=True))
    else:
        yield stream.name, None, stream.columns


def _repeats(recording: Recording, members: tuple[str, ...]) -> Iterator[Indices]:
    """List the stretches of at least ``LEAST`` seconds in which columns repeat their numbers."""
    values = recording.stack(members)
    seen = np.flatnonzero(np.isfinite(values).all(axis=1))
    if not len(seen):
        return
    changes = np.flatnonzero((np.diff(values[seen], axis=0) != 0.0).any(axis=1))
    first, last = np.append(0, changes + 1), np.append(changes, len(seen) - 1)
    lasting = (last - first >= 2) & (recording.time[seen[last]] - recording.time[seen[first]] >= LEAST)
    for begin, end in zip(first[lasting], last[lasting], strict=True):
        yield seen[begin : end + 1]


def _noisy(values: Floats) -> bool:
    """Return whether readings show noise: their second differences alternate, those of motion do not."""
    bends = np.diff(values[np.isfinite(values).all(axis=1)], 2, axis=0)
    products = np.where(np.abs(bends) > REPEATED, bends, 0.0)[1:] * bends[:-1]
    alternate, go_on = ((sign * products > 0.0).sum() for sign in (-1.0, 1.0))
    return bool(alternate > max(go_on, 0.1 * products.size))


def _unmoved(recording: Recording, specimen: Specimen) -> list[StuckReading]:
    """Find axes of bends that show nothing but noise while their chambers should move them.

    Bends beside frames are computed from them, and no sensors.
    """
    if len(recording.time) < 2:
        return []
    windows = _windows(recording.time)
    streams = [stream for stream in streams_of(recording, specimen) if stream.kind == "bend"]
    streams = [stream for stream in streams if stream.target not in recording.frames]
    drives = [_drive(recording, specimen, stream.target) for stream in streams]

    def axes(stream: SampledStream, drive: Floats) -> BendAxes:
        count = int(windows[-1]) + 1
        return BendAxes(window_means(stream.values, windows, count), window_means(drive, windows, count))

    def lagging(stream: SampledStream, drive: Floats) -> BendAxes:
        tried = sorted(LAGS, key=abs)
        every = (axes(stream, delayed(recording.time, drive, lag)) for lag in tried)
        return min(every, key=BendAxes.unexplained)

    found = _undriven(recording.time, streams, [axes(*one) for one in zip(streams, drives, strict=True)])
    if not found:
        return found
    return _undriven(recording.time, streams, [lagging(*one) for one in zip(streams, drives, strict=True)])


def _undriven(
    time: Floats, streams: Sequence[SampledStream], bends: Sequence[BendAxes]
) -> list[StuckReading]:
    """Find axes that are quiet while their drive should move them."""
    found = []
    for stream, bend in zip(streams, bends, strict=True):
        for axis in (0, 1):
            own = slice(axis, axis + 1)
            quiet = _quiet(time, stream.values[:, own], bend.values[:, own], QUIET["rad"])
            for during, seen in quiet:
                wanted = bend.wanted(axis, during, bends)
                if wanted > CLEAR * QUIET["rad"]:
                    words = f"while the pressures should move it by about {np.degrees(wanted):.0f} degrees"
                    found.append(StuckReading(stream.name, "xy"[axis], (stream.columns[axis],), seen, words))
    return found


def _left_behind(recording: Recording, specimen: Specimen) -> list[StuckReading]:
    """Find bodies that show nothing but noise while a body above them moves.

    While no pressure changes an arm rests, and a body above that seems to move was stuck itself until then.
    """
    if len(recording.time) < 2:
        return []
    pressures = pressures_of(recording)
    windows = _windows(recording.time)
    heights = {one.name: one.from_m for one in specimen.sections}
    bodies = sorted(
        (stream for stream in streams_of(recording, specimen) if stream.kind == "frame"),
        key=lambda stream: heights.get(stream.target, 0.0),
    )
    moved = [window_means(body.values, windows, int(windows[-1]) + 1) for body in bodies]
    found = []
    for number, (body, values) in enumerate(zip(bodies, moved, strict=True)):
        limits = np.array([QUIET[unit] for unit in body.units])
        for during, seen in _quiet(recording.time, body.values, values, limits):
            if recording.chambers and not _pressed(pressures, seen):
                continue
            above = [other[during, :3] for other in moved[:number]]
            ways = [float(np.nan_to_num(_spread(axis))) for other in above for axis in other.T]
            if max(ways, default=0.0) > CLEAR * QUIET["m"]:
                words = f"while a body above it moves by {1e3 * max(ways):.0f} mm"
                found.append(StuckReading(body.name, None, body.columns, seen, words))
    return found


def _drive(recording: Recording, specimen: Specimen, section: str) -> Floats:
    """Sum up v of the segments between a section and the one above it [Pa], shape (samples, 2).

    It is NaN where it is less than what chambers under like pressures push by because they differ.
    """
    begins = [0.0, *(one.from_m for one in specimen.sections)]
    here = next((one.from_m for one in specimen.sections if one.name == section), 0.0)
    above = max((z for z in begins if z < here), default=0.0)
    segments = [one.name for one in specimen.segments if above <= one.from_m < here]
    chambers = [number for number in recording.chambers if specimen.chambers[number].segment in segments]
    pressures = pressures_of(recording)[:, np.isin(recording.chambers, chambers)]
    drive = -pushes_of(pressures, chambers, specimen).sum(axis=1)
    whole = pressures.sum(axis=1)
    balanced = (np.abs(drive) < UNEQUAL * whole) & (whole > ASKED)
    return np.where(balanced[:, None], np.nan, np.column_stack([drive.real, drive.imag]))


def _windows(time: Floats) -> Indices:
    """Return the window of each sample, shape (samples,)."""
    windows: Indices = ((time - time[0]) / WINDOW).astype(np.int64)
    return windows


def _quiet(
    time: Floats, readings: Floats, values: Floats, limits: Floats | float, least: float = LEAST
) -> Iterator[tuple[slice, Indices]]:
    """List the longest stretches in which all means stay within limits.

    Args:
        time: [s], shape (samples,).
        readings: Shape (samples, columns).
        values: Their means, shape (windows, columns).
        limits: Of each column.
        least: How long a stretch lasts at least [s].

    Returns:
        The windows of each stretch, and the samples in them that were read.
    """
    windows, read, first = _windows(time), np.isfinite(readings).all(axis=1), 0
    while first < len(values):
        low = np.fmin.accumulate(values[first:], axis=0)
        high = np.fmax.accumulate(values[first:], axis=0)
        left = (high - low > limits).any(axis=1)
        beyond = first + int(np.argmax(np.append(left, True)))
        if (beyond - first) * WINDOW < least:
            first += 1
            continue
        seen = np.flatnonzero((windows >= first) & (windows < beyond) & read)
        if len(seen) and np.ptp(time[seen]) >= least:
            yield slice(first, beyond), _to_its_ends(time, readings, seen)
        first = beyond


def _to_its_ends(time: Floats, readings: Floats, rows: Indices) -> Indices:
    """Extend a quiet stretch by the samples of the windows at its ends that still read as it does.

    Args:
        time: [s], shape (samples,).
        readings: Shape (samples, columns).
        rows: Samples of the whole windows of the stretch, rising.
    """
    low, high = readings[rows].min(axis=0), readings[rows].max(axis=0)
    margin = 0.5 * (high - low)
    alike = ((readings >= low - margin) & (readings <= high + margin)).all(axis=1)
    near = (time > time[rows[0]] - WINDOW) & (time < time[rows[-1]] + WINDOW)
    ends = [run for run in runs(alike & near) if run[0] <= rows[0] <= run[1] or run[0] <= rows[-1] <= run[1]]
    whole: Indices = np.union1d(rows, np.concatenate([np.arange(*run) for run in ends]))
    return whole
