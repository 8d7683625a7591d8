"""Readings that are none: numbers in the place of a lost body, and samples far off both their neighbours."""

from dataclasses import replace

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.intake.limits import OVERSHOOT
from softarm.estimator.intake.result import MOTION, RecordingFault
from softarm.estimator.intake.streams import SampledStream, streams_of
from softarm.estimator.recording import BEND_SUFFIXES, MARKER_SUFFIXES, POSE_SUFFIXES, Recording
from softarm.estimator.series import runs
from softarm.estimator.specimen import Specimen
from softarm.estimator.statistics import MAD_TO_STD

LONGEST = 2
"""Samples of a spike at most; what lasts longer is an event."""
LEAST = {"rad": np.radians(5.0), "m": 0.01}
"""Excursions below this size in every unit are left alone."""
NOISE = 12.0
"""Excursions below so many robust deviations of the second differences are noise or motion."""
SLOWEST = 0.03
"""In recordings with longer steps [s] the arm itself may swing there and back within two samples."""
FARTHEST = 50.0
"""No body is seen farther from the origin of the laboratory [m]: no motion-capture volume is larger."""
OUTSIDE = 5.0
"""Times the travel of a body by which a number that stands for a lost body lies off its usual place."""
UNIT = 0.02
"""By which the norm of a quaternion may differ from one."""
LARGEST_BEND = 720.0
"""Bends beyond this are none, not even in degrees."""
BACK = 0.3
"""Share of an excursion by which the samples before and after may differ."""


def correct_lost(recording: Recording, specimen: Specimen) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Count zeros of lost bodies and spikes as lost readings.

    Optical systems write zeros for a body that they do not see. A spike leaves and returns within
    ``LONGEST`` samples, farther than the recording's own motion and noise go.
    """
    columns = dict(recording.columns)
    words: dict[str, str] = {}
    fast = len(recording.time) > 5 and float(np.median(np.diff(recording.time))) <= SLOWEST
    for stream in streams_of(without_zeros(recording), specimen):
        zeros = _zeros(recording, stream)
        readings = np.where(zeros[:, None], np.nan, stream.values)
        spikes = _spikes(readings, stream.units) if fast else np.zeros(len(zeros), dtype=bool)
        beyond = _beyond(readings, stream)
        for name in stream.columns:
            columns[name] = np.where(zeros | spikes | beyond, np.nan, columns[name])
        far = f"readings beyond {FARTHEST:.0f} m"
        counts = {"zeros": int(zeros.sum()), "spikes": int((spikes & ~beyond).sum()), far: int(beyond.sum())}
        words |= {stream.name: " and ".join(f"{n} {what}" for what, n in counts.items() if n)}
    for chamber in recording.chambers:
        name = f"pressure_{chamber}_pa"
        if name in columns and chamber < len(specimen.pressure_limits):
            bad = _pressure_spikes(columns[name], OVERSHOOT * specimen.pressure_limits[chamber])
            columns[name] = np.where(bad, np.nan, columns[name])
            words |= {name: f"{int(bad.sum())} spikes" if bad.any() else ""}
    bad_streams = tuple(name for name, what in words.items() if what)
    if not bad_streams:
        return recording, ()
    what = "readings that cannot be true: " + ", ".join(f"{name} {words[name]}" for name in bad_streams)
    found = RecordingFault(recording.name, "lost", bad_streams, what, "counted as lost")
    return replace(recording, columns=columns), (found,)


def correct_unrecorded(
    recording: Recording, specimen: Specimen
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Drop pressures without any reading, and name the chambers that count as vented for want of one."""
    empty = {
        name
        for name, values in recording.columns.items()
        if name.startswith("pressure_") and not np.isfinite(values).any()
    }
    recording = replace(recording, columns={n: v for n, v in recording.columns.items() if n not in empty})
    missing = sorted({*range(len(specimen.chambers))} - {*recording.chambers})
    if (
        not missing
        or not recording.chambers
        or not any(name.startswith(MOTION) for name in recording.columns)
    ):
        return recording, ()
    columns = tuple(f"pressure_{chamber}_pa" for chamber in missing)
    many = len(missing) > 1
    listed = f"chamber{'s' if many else ''} {', '.join(map(str, missing))}"
    what = (
        f"no pressure of {listed} was recorded, so {'they count' if many else 'it counts'} as vented (0 Pa)"
    )
    cure = f"if {'they were' if many else 'it was'} not, add {', '.join(columns)} [Pa, gauge]"
    return recording, (RecordingFault(recording.name, "lost", columns, what, cure),)


def correct_placeholders(
    recording: Recording,
    specimen: Specimen,  # noqa: ARG001
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """Count as lost the numbers that stand for lost bodies, such as -9999, whatever the unit.

    A body that is seen does not read one number on all axes, nor a quaternion of four equal ones that is not
    of unit length.
    """
    columns, words = dict(recording.columns), []
    bodies = [("frame", name, recording.pose(name)) for name in recording.frames]
    bodies += [("marker", name, recording.marker(name)) for name in recording.markers]
    bodies += [("bend", name, recording.bend(name)) for name in recording.bends]
    for kind, name, values in bodies:
        lost = _placeholders(values, kind)
        if not lost.any():
            continue
        numbers = np.unique(values[lost][:, 0])
        listed = ", ".join(f"{number:.6g}" for number in numbers[:3])
        words.append(f"{kind}_{name} {int(lost.sum())} times {listed}{' ...' if len(numbers) > 3 else ''}")
        suffixes = {"frame": POSE_SUFFIXES, "marker": MARKER_SUFFIXES, "bend": BEND_SUFFIXES}[kind]
        for column in (f"{kind}_{name}_{suffix}" for suffix in suffixes):
            columns[column] = np.where(lost, np.nan, columns[column])
    if not words:
        return recording, ()
    bad = tuple(word.split()[0] for word in words)
    what = f"one number on all axes stands for lost bodies: {', '.join(words)}"
    found = RecordingFault(recording.name, "lost", bad, what, "counted as lost")
    return replace(recording, columns=columns), (found,)


def _placeholders(values: Floats, kind: str) -> Flags:
    """Find samples of one number on all axes that is no place of a body, shape (samples,).

    Args:
        values: As recorded, shape (samples, 2, 3 or 7).
        kind: Of the body.
    """
    places, quaternions = values[:, :3], values[:, 3:]
    alike = np.asarray((places == places[:, :1]).all(axis=1) & (places[:, 0] != 0.0))
    if kind == "bend":
        return np.asarray(alike & (np.abs(places[:, 0]) > LARGEST_BEND))
    none = np.zeros(len(values), dtype=bool)
    if kind == "frame":
        norms = np.linalg.norm(quaternions, axis=1)
        none = np.asarray(
            (quaternions == quaternions[:, :1]).all(axis=1) & (norms > 0.0) & (np.abs(norms - 1.0) > UNIT)
        )
    seen = np.isfinite(places).all(axis=1) & ~alike & ~none
    if seen.sum() <= alike.sum():
        return none
    usual = np.median(places[seen], axis=0)
    travel = float(np.linalg.norm(np.ptp(np.percentile(places[seen], (5.0, 95.0), axis=0), axis=0)))
    away = np.linalg.norm(places - usual, axis=1)
    return np.asarray(none | (alike & (away > OUTSIDE * travel)))


def _beyond(values: Floats, stream: SampledStream) -> Flags:
    """Find the positions farther away than any body is seen, where most are nearer, shape (samples,)."""
    if stream.kind == "bend":
        return np.zeros(len(values), dtype=bool)
    far = np.asarray((np.abs(values[:, :3]) > FARTHEST).any(axis=1))
    seen = np.isfinite(values[:, :3]).all(axis=1)
    return far if 2 * far.sum() < seen.sum() else np.zeros_like(far)


def without_zeros(recording: Recording) -> Recording:
    """Drop poses whose quaternion is zero, which is no orientation."""
    columns = dict(recording.columns)
    for section in recording.frames:
        names = [name for name in columns if name.startswith(f"frame_{section}_")]
        none = ~recording.pose(section)[:, 3:].any(axis=1)
        columns.update({name: np.where(none, np.nan, columns[name]) for name in names})
    return replace(recording, columns=columns)


def _zeros(recording: Recording, stream: SampledStream) -> Flags:
    """Find samples in which a moved body reads zero throughout, shape (samples,); a bend may be zero."""
    values = recording.stack(stream.columns)
    zero = np.asarray(~values.any(axis=1))
    if stream.kind == "bend":
        return np.zeros_like(zero)
    if stream.kind == "frame":
        return zero | ~values[:, 3:].any(axis=1)
    others = np.linalg.norm(values[~zero & np.isfinite(values).all(axis=1)], axis=1)
    edge = np.flatnonzero(np.diff(zero.astype(int)))
    jumps = np.linalg.norm(np.diff(values, axis=0)[edge], axis=1)
    if not len(others) or not zero.any() or not (np.nan_to_num(jumps) > LEAST[stream.units[0]]).all():
        return np.zeros_like(zero)
    return zero


def _spikes(values: Floats, units: tuple[str, ...]) -> Flags:
    """Find single samples, or two, that lie far off those before and after, shape (samples,)."""
    bad = np.zeros(len(values), dtype=bool)
    for column, unit in zip(values.T, units, strict=True):
        finite = np.flatnonzero(np.isfinite(column))
        if len(finite) < 2 * LONGEST + 3:
            continue
        readings = column[finite]
        noise = MAD_TO_STD * float(np.median(np.abs(np.diff(readings, 2))))
        bad[finite[_excursions(readings, max(LEAST[unit], NOISE * noise))]] = True
    return bad


def _excursions(values: Floats, least: float) -> Flags:
    """Find runs of up to ``LONGEST`` samples that lie ``least`` off the samples on both sides of them."""
    flags = np.zeros(len(values), dtype=bool)
    for length in range(1, LONGEST + 1):
        before, after = values[: -length - 1], values[length + 1 :]
        inside = np.stack([values[1 + k : len(values) - length + k] for k in range(length)])
        away = inside - 0.5 * (before + after)
        size = np.abs(away).min(axis=0)
        one_way = np.abs(away.sum(axis=0)) > (length - 0.5) * size
        starts = np.flatnonzero((size > least) & one_way & (np.abs(after - before) < BACK * size))
        for k in range(length):
            flags[starts + 1 + k] = True
    return flags


def _pressure_spikes(values: Floats, most: float) -> Flags:
    """Find runs of up to ``LONGEST`` readings far beyond ``most`` [Pa] either way, shape (samples,)."""
    beyond = np.abs(np.nan_to_num(values)) > most
    spikes = np.zeros(len(values), dtype=bool)
    for begin, end in runs(beyond):
        spikes[begin:end] = end - begin <= LONGEST and np.abs(values[begin:end]).min() > 1.5 * most
    return spikes
