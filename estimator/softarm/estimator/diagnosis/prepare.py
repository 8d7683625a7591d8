"""From a recording to a session: independent sensors, known loads, means over windows."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Flags, Floats, Indices
from softarm.estimator.calibration import CalibrationRun, arrange, section_forces
from softarm.estimator.calibration.pulls import HOOK, LEAST_PULL, gauged_section
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.errors import InputError
from softarm.estimator.model import Load
from softarm.estimator.recording import Recording
from softarm.estimator.rotations import from_quaternions
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.series import inside, window_means
from softarm.estimator.specimen import Specimen

BLOCK = 10.0
"""Length of the stretches that are held out or judged as a whole [s]; shorter in short recordings."""
LEAST_BLOCKS = 7
"""The fewest of which two can be spared: one confirms what is chosen, the other is reported."""
SAME = np.radians(0.2)
"""Bends that repeat what frames show to within this are left out."""
RINGING = 0.11
"""Windows longer than this [s] are there to average a vibration away."""
QUIETEST, QUIET_SIZE = 10.0, 0.1257
"""Percentile of the changes between windows at rest that gives the noise, and that of a standard normal."""
ROUNDING = 1e-3
"""Share of a window by which a clock may be rounded without its samples changing windows."""
RESTING = 500.0
"""Pressures that change by less within a window rest [Pa]."""


@dataclass(frozen=True)
class Prepared:
    """A session at its native rate, and what was noticed on the way.

    Args:
        notes: Plain sentences.
    """

    session: Session
    notes: tuple[str, ...]


def prepare(
    recording: Recording,
    specimen: Specimen,
    sections: tuple[str, ...],
    *,
    nominal: bool,
    events: Sequence[tuple[float, float]] = (),
) -> Prepared:
    """Arrange a recording for a diagnosis, at its own rate.

    Gravity is the recording's ``gravity_m_s2`` where it has one, else the specimen's. A force gauge becomes a
    known load as in a calibration.

    Args:
        recording: What was recorded.
        specimen: The robot.
        sections: Sections of the model.
        nominal: Whether it shows the arm in its known state.
        events: Stretches of its time [s] whose readings no fit may see.

    Raises:
        InputError: The recording does not fit the specimen, holds no motion, or a gauge was saturated.
    """
    notes: list[str] = []
    described = _without_unknown_gauges(_without_unknown_markers(recording, specimen, notes), specimen, notes)
    forces = section_forces(specimen)
    run = arrange(_without_repeated_bends(described, specimen, notes), specimen, sections, forces)
    present = np.isfinite(run.pressures).all(axis=1) & np.isfinite(run.loads).all(axis=1)
    run = run.window(np.asarray(present))
    if len(run.time) < 2:
        raise InputError(recording.name, "pressures and motion are never present together", "record both")
    samples = len(run.time)
    during = inside(run.time, events)[:, None]
    session = Session(
        name=recording.name,
        nominal=nominal,
        clock=run.time + recording.start,
        start=recording.start,
        pressures=run.pressures,
        gravity=np.tile(run.gravity, (samples, 1)),
        wrenches=_wrenches(run, forces, sections),
        suite=run.suite,
        readings=np.where(during, np.nan, run.readings),
        sigma=np.zeros(run.suite.size),
        blocks=blocks_of(run.time),
        heldout=np.zeros(samples, dtype=bool),
        commanded="commanded" in run.pressure_source,
        event_readings=np.where(during, run.readings, np.nan) if during.any() else None,
    )
    return Prepared(session, tuple(notes))


def averaged(session: Session, step: float) -> Session:
    """Average a session over windows, the noise of the means included.

    White noise is that of the second differences of the readings; it falls with the root of their number.
    What wanders more slowly stays: it is measured between neighbouring windows of the quietest stretches.

    Args:
        session: At its own rate.
        step: Length of a window [s]; a session that is slower stays as it is.
    """
    count = max(1, round(step / session.step))
    windows = ((session.clock - session.clock[0]) / (count * session.step) + ROUNDING).astype(np.int64)
    numbers, places = np.unique(windows, return_inverse=True)
    size = len(numbers)
    events = session.event_readings
    clock = window_means(session.clock[:, None], places, size)[:, 0]
    mean = replace(
        session,
        clock=clock,
        pressures=window_means(session.pressures, places, size),
        gravity=window_means(session.gravity, places, size),
        wrenches=window_means(session.wrenches.reshape(session.samples, -1), places, size).reshape(
            size, *session.wrenches.shape[1:]
        ),
        readings=_unit(session.suite, window_means(session.readings, places, size)),
        blocks=blocks_of(clock),
        heldout=np.zeros(size, dtype=bool),
        event_readings=None if events is None else _unit(session.suite, window_means(events, places, size)),
    )
    white = _white_noise(session) / np.sqrt(count)
    whole = replace(mean, sigma=np.maximum(np.hypot(white, _wander(mean)), _resolution(session)))
    return whole.thin(_steady(session, places, size)) if step > RINGING else whole


def _steady(session: Session, places: NDArray[np.int64], size: int) -> Flags:
    """Return in which windows the pressures rest: long windows are there to average a vibration away."""
    highest = np.full((size, session.pressures.shape[1]), -np.inf)
    lowest = np.full_like(highest, np.inf)
    np.maximum.at(highest, places, session.pressures)
    np.minimum.at(lowest, places, session.pressures)
    steady = np.asarray((highest - lowest).max(axis=1, initial=0.0) < RESTING)
    return steady if steady.sum() >= LEAST_BLOCKS else np.ones(size, dtype=bool)


def blocks_of(time: Floats) -> Indices:
    """Number the stretches of time that samples belong to."""
    seconds = float(time[-1] - time[0])
    length = min(BLOCK, max(seconds, 1e-9) / LEAST_BLOCKS * (1.0 + 2.0 * ROUNDING))
    blocks: Indices = ((time - time[0]) / length + ROUNDING).astype(np.int64)
    return blocks


def _without_unknown_markers(recording: Recording, specimen: Specimen, notes: list[str]) -> Recording:
    described = {marker.name for marker in specimen.markers}
    unknown = [name for name in recording.markers if name not in described and name != HOOK]
    kept = [name for name in recording.markers if name in described]
    if unknown and not kept and not recording.frames and not recording.bends:
        listed = ", ".join(unknown)
        raise InputError(
            recording.name, f"none of its markers ({listed}) is in the specimen", "give the right specimen"
        )
    if unknown:
        notes.append(f"{recording.name}: markers {', '.join(unknown)} are not in the specimen and left out.")
    return _without_columns(recording, [f"marker_{marker}_" for marker in unknown])


def _without_repeated_bends(recording: Recording, specimen: Specimen, notes: list[str]) -> Recording:
    """Leave out bends that were computed from the frames: they would count the same evidence twice."""
    order = [section.name for section in specimen.sections]
    repeated = []
    for section in recording.bends:
        above = order[order.index(section) - 1] if order.index(section) > 0 else None
        if section in recording.frames and above in recording.frames:
            expected = _tilt(recording.pose(above or ""), recording.pose(section))
            difference = np.abs(expected - recording.bend(section))
            if np.isfinite(difference).any() and float(np.nanmedian(difference)) < SAME:
                repeated.append(section)
    if repeated:
        notes.append(f"{recording.name}: bends of {', '.join(repeated)} repeat the frames and are left out.")
    return _without_columns(recording, [f"bend_{section}_" for section in repeated])


def _without_columns(recording: Recording, prefixes: Sequence[str]) -> Recording:
    kept = {n: v for n, v in recording.columns.items() if not n.startswith(tuple(prefixes))}
    return replace(recording, columns=kept)


def _tilt(above: Floats, below: Floats) -> Floats:
    observed = np.isfinite(above).all(axis=1) & np.isfinite(below).all(axis=1)
    tilt = np.full((len(above), 2), np.nan)
    if observed.any():
        upper, lower = from_quaternions(above[observed, 3:]), from_quaternions(below[observed, 3:])
        axis = np.einsum("tji,tj->ti", upper, lower[:, :, 2])
        sine = np.linalg.norm(axis[:, :2], axis=1)
        angle = np.arctan2(sine, axis[:, 2])
        tilt[observed] = axis[:, :2] * (angle / np.maximum(sine, 1e-12))[:, None]
    return tilt


def _without_unknown_gauges(recording: Recording, specimen: Specimen, notes: list[str]) -> Recording:
    """Leave out gauges that pull where, or along which line, nobody knows."""
    sections = [section.name for section in specimen.sections]
    line = HOOK in recording.markers or "gauge_direction" in recording.info
    unknown = []
    for gauge in recording.gauges:
        try:
            described = line and bool(gauged_section(recording, gauge, sections))
        except InputError:
            described = False
        taut = float(np.nanmax(np.abs(recording.gauge(gauge)), initial=0.0)) > LEAST_PULL
        if taut and not described:
            unknown.append(gauge)
            notes.append(
                f"{recording.name}: gauge {gauge} pulls, but where and along which line is not known "
                "(gauge_section and marker_hook); its force is not in the model."
            )
    left_out = {f"gauge_{gauge}_n" for gauge in unknown}
    columns = {name: values for name, values in recording.columns.items() if name not in left_out}
    return replace(recording, columns=columns)


def _wrenches(run: CalibrationRun, forces: Sequence[Load], sections: tuple[str, ...]) -> Floats:
    """Arrange the known forces as wrenches on the sections, shape (samples, sections, 6)."""
    wrenches = np.zeros((len(run.time), len(sections), 6))
    for force, amplitude in zip(forces, run.loads.T, strict=True):
        wrenches[:, sections.index(str(force.section)), :3] += amplitude[:, None] * force.direction
    return wrenches


def _orientations(suite: SensorSuite) -> list[slice]:
    """Find the quaternions among the stacked readings."""
    ends = [suite.reading_slices[m.name].stop for m in suite.measurements if m.reading_size in (4, 7)]
    return [slice(end - 4, end) for end in ends]


def _unit(suite: SensorSuite, readings: Floats) -> Floats:
    out = readings.copy()
    for orientations in _orientations(suite):
        out[:, orientations] /= np.linalg.norm(out[:, orientations], axis=1, keepdims=True)
    return out


def _rows(session: Session) -> Floats:
    """Return readings as vectors about their first, shape (samples, rows)."""
    from_first = np.empty((session.samples, session.suite.size))
    suite = session.suite
    for measurement in suite.measurements:
        part = session.readings[:, suite.reading_slices[measurement.name]]
        if measurement.reading_size in (4, 7):
            # Small rotations are twice the vector part of the quaternion against the median.
            middle = np.nanmedian(part[:, -4:], axis=0)
            part = np.concatenate([part[:, :-4], 2.0 * _vector_part(part[:, -4:], middle)], axis=1)
        from_first[:, suite.slices[measurement.name]] = part
    return from_first


def _vector_part(quaternions: Floats, reference: Floats) -> Floats:
    """Return the vector part of conj(reference) times quaternions (w, x, y, z)."""
    w, v = reference[0], -reference[1:]
    product: Floats = w * quaternions[:, 1:] + quaternions[:, :1] * v + np.cross(v, quaternions[:, 1:])
    return product


def _white_noise(session: Session) -> Floats:
    """Return the standard deviation of white noise of each row by second differences, shape (rows,)."""
    rows = _rows(session)
    if len(rows) < 5:
        return np.zeros(rows.shape[1])
    second = np.diff(rows, 2, axis=0)
    sigma = np.zeros(rows.shape[1])
    for index, column in enumerate(second.T):
        observed = column[np.isfinite(column)]
        if len(observed):
            # The quieter half of the run: motion itself has second differences too.
            sigma[index] = np.percentile(np.abs(observed), 25.0) / 0.3186 / np.sqrt(6.0)
    return sigma


def _wander(session: Session) -> Floats:
    """Return the spread of each row between neighbouring windows where the pressures rest, shape (rows,)."""
    rows = _rows(session)
    still = np.abs(np.diff(session.pressures, axis=0)).max(axis=1, initial=0.0) < 150.0
    sigma = np.zeros(rows.shape[1])
    for index, column in enumerate(rows.T):
        change = np.abs(np.diff(column))
        quiet = change[still & np.isfinite(change)]
        if len(quiet) > 10:
            sigma[index] = np.percentile(quiet, QUIETEST) / QUIET_SIZE / np.sqrt(2.0)
    return sigma


def _resolution(session: Session) -> Floats:
    """Return a tenth of the specimen's noise, below which no mean is believed, shape (rows,)."""
    smallest: Floats = 0.1 * session.suite.noise
    return smallest
