"""From a recording and a specimen to sensors, their stacked readings and the pressures beside them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from difflib import get_close_matches

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.calibration.pulls import LEAST_PULL, known_pulls
from softarm.estimator.errors import InputError
from softarm.estimator.model import Load
from softarm.estimator.recording import Recording
from softarm.estimator.rotations import exp, from_quaternions, mean_rotation, without_jumps
from softarm.estimator.sensing import Measurement, Registration, SensorSuite, register
from softarm.estimator.sensors import SpecimenSensors
from softarm.estimator.series import interpolate
from softarm.estimator.specimen import Specimen

SYSTEMATIC_SHARE = 0.25  # of a marker's noise that stays however many readings are averaged
OVERSHOOT = 1.1  # a measured pressure may pass the limit that commands must keep by this factor


@dataclass(frozen=True)
class CalibrationRun:
    """A recording arranged for a model of its specimen.

    Args:
        name: Name of the recording.
        time: Times [s], shape (samples,).
        pressures: Recorded gauge pressures [Pa], zero for chambers that were not connected, NaN where lost,
            shape (samples, chambers).
        pressure_source: ``measured``, ``commanded`` or ``none`` of each chamber.
        suite: The sensors that the recording has.
        readings: Stacked readings, NaN where lost, shape (samples, readings).
        loads: Known forces on the arm, amplitudes of the loads it was arranged for [N], NaN where lost,
            shape (samples, loads).
        load_names: Names of those loads.
        registration: Laboratory to base, as it was arranged.
        ignored_markers: Markers of the recording that the specimen does not name, such as one on a gauge's
            hook.
        gravity: Gravitational acceleration in the base frame [m/s2], shape (3,): the recording's own where it
            states how the arm was mounted.
    """

    name: str
    time: Floats
    pressures: Floats
    pressure_source: tuple[str, ...]
    suite: SensorSuite
    readings: Floats
    loads: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    load_names: tuple[str, ...] = ()
    registration: Registration = field(default_factory=Registration)
    ignored_markers: tuple[str, ...] = ()
    gravity: Floats = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        if not self.load_names:
            object.__setattr__(self, "loads", np.zeros((len(self.time), 0)))

    @property
    def pulled(self) -> bool:
        """Whether a known force acts on the arm at some time."""
        return bool((np.abs(np.nan_to_num(self.loads)) > LEAST_PULL).any())

    def window(self, keep: Flags) -> "CalibrationRun":
        """Keep some samples, shape (samples,)."""
        return replace(
            self,
            time=self.time[keep],
            pressures=self.pressures[keep],
            readings=self.readings[keep],
            loads=self.loads[keep],
        )

    def delayed(self, lag: float) -> "CalibrationRun":
        """Move the pressures to a clock that is ``lag`` seconds ahead of that of the motion."""
        moved = [interpolate(self.time - lag, self.time, column) for column in self.pressures.T]
        pressures = np.column_stack(moved) if moved else self.pressures
        return replace(self, pressures=pressures)


def arrange(
    recording: Recording,
    specimen: Specimen,
    sections: Sequence[str] | None = None,
    loads: Sequence[Load] = (),
) -> CalibrationRun:
    """Arrange a recording.

    Bends, poses and markers become sensors with the specimen's noise and calibration; markers and poses of
    the first section register the laboratory in the base frame. Pressures are brought to the times of the
    motion.

    Args:
        recording: What was recorded.
        specimen: The arm.
        sections: Sections of the model; those of the specimen when left out.
        loads: Forces, as of ``section_forces``, that describe the gauges' pulls; none when left out.

    Raises:
        InputError: The recording has a section or chamber that the specimen lacks, no motion, pressures above
            the specimen's limits, or a gauge at the end of its range.
    """
    names = tuple(sections or (section.name for section in specimen.sections))
    pressures, sources = _pressures(recording, specimen)
    registration = registration_of(recording, specimen, names[0])
    make = SpecimenSensors(specimen, names, registration)
    sensors = {**_bends(recording, make), **_poses(recording, make), **_markers(recording, make)}
    described = {marker.name for marker in specimen.markers}
    unknown = tuple(name for name in recording.markers if name not in described)
    if not sensors:
        cure = "add bends, frames or markers of a section below the base"
        foreign = f": the specimen has no marker {unknown[0]!r}" if unknown else ""
        raise InputError(recording.name, f"holds no motion of the arm{foreign}", cure)
    suite = SensorSuite(tuple(sensor for sensor, _ in sensors.values()))
    readings = suite.stack({name: values for name, (_, values) in sensors.items()})
    rows = np.isfinite(readings).any(axis=1)
    if not rows.any():
        raise InputError(
            recording.name,
            "no reading of its motion can be fitted",
            "record motion that is seen and no event",
        )
    pulls = known_pulls(recording, specimen, registration, loads)
    # A gauge reads at its own times; between two readings its force is assumed to change evenly.
    bridged = [interpolate(recording.time, recording.time, column) for column in pulls.T]
    run = CalibrationRun(
        recording.name,
        recording.time,
        pressures,
        sources,
        suite,
        readings,
        np.column_stack(bridged) if bridged else pulls,
        tuple(load.name for load in loads),
        registration,
        unknown,
        gravity_of(recording, specimen),
    )
    # Rows that only other streams filled show no motion to fit.
    return run.window(np.asarray(rows))


def gravity_of(recording: Recording, specimen: Specimen) -> Floats:
    """Return gravity in the base frame [m/s2], shape (3,): the recording's own, else the specimen's.

    Raises:
        InputError: The recording's is not three finite numbers.
    """
    stated = recording.info.get("gravity_m_s2", specimen.gravity_m_s2)
    try:
        gravity = np.array(stated, dtype=np.float64)
    except (TypeError, ValueError):
        gravity = np.empty(0)
    if gravity.shape != (3,) or not np.isfinite(gravity).all():
        raise InputError(f"{recording.name}, gravity_m_s2", f"is {stated}", "give x, y and z in m/s2")
    return gravity


def _pressures(recording: Recording, specimen: Specimen) -> tuple[Floats, tuple[str, ...]]:
    limits = specimen.pressure_limits
    if len(limits) and not recording.chambers:
        raise InputError(
            recording.name,
            "holds no pressures, and the arm has chambers",
            "record pressure_0_pa and its like along with the motion; zeros where the arm was vented",
        )
    pressures = np.zeros((len(recording.time), len(limits)))
    sources = ["none"] * len(limits)
    for chamber in recording.chambers:
        if chamber >= len(limits):
            raise InputError(
                f"{recording.name}, pressure_{chamber}_pa",
                f"the specimen has {len(limits)} chambers",
                "give the specimen that was recorded, or remove the column",
            )
        values, sources[chamber] = recording.pressure(chamber)
        moving = np.asarray(_motion_seen(recording))
        _check_limit(recording, chamber, values[moving], limits[chamber], sources[chamber])
        pressures[:, chamber] = interpolate(recording.time, recording.time, values)
    return pressures, tuple(sources)


def _motion_seen(recording: Recording) -> Flags:
    """Find samples with any reading of motion: only these are used, so only these must keep the limits."""
    kinds = ("bend_", "frame_", "marker_")
    motion = [np.isfinite(v) for name, v in recording.columns.items() if name.startswith(kinds)]
    return np.any(motion, axis=0) if motion else np.ones(len(recording.time), dtype=bool)


def _check_limit(recording: Recording, chamber: int, values: Floats, limit: float, source: str) -> None:
    allowed = limit * (OVERSHOOT if source == "measured" else 1.0)
    highest = float(np.nanmax(values, initial=0.0))
    if highest > allowed:
        raise InputError(
            f"{recording.name}, {source} pressure of chamber {chamber}",
            f"{highest:.0f} Pa is above the specimen's limit of {limit:.0f} Pa",
            "correct the unit, or raise pressure_limit_pa in the specimen",
        )


def _require_section(recording: Recording, what: str, section: str, names: Sequence[str]) -> None:
    if section not in names:
        close = get_close_matches(section, names, n=1, cutoff=0.0)[0]
        raise InputError(
            f"{recording.name}, {what} {section}",
            f"the specimen has no section {section!r}",
            f"the nearest of its sections is {close}; rename the columns or give the right specimen",
        )


Sensors = dict[str, tuple[Measurement, Floats]]


def _bends(recording: Recording, make: SpecimenSensors) -> Sensors:
    for section in recording.bends:
        _require_section(recording, "bend", section, make.sections)
    made = [(make.bend(section), recording.bend(section)) for section in recording.bends]
    return {sensor.name: (sensor, values) for sensor, values in made}


def _poses(recording: Recording, make: SpecimenSensors) -> Sensors:
    for section in recording.frames:
        _require_section(recording, "frame", section, make.sections)
    # The pose of the base registers the laboratory; as a sensor it would only repeat that.
    below = [section for section in recording.frames if section != make.sections[0]]
    made = [(make.pose(section), _averageable(recording.pose(section))) for section in below]
    return {sensor.name: (sensor, values) for sensor, values in made}


def _averageable(poses: Floats) -> Floats:
    return np.column_stack([poses[:, :3], without_jumps(poses[:, 3:])])


def _markers(recording: Recording, make: SpecimenSensors) -> Sensors:
    markers = {marker.name: marker for marker in make.specimen.markers}
    named = [name for name in recording.markers if name in markers]
    below = [name for name in named if markers[name].section != make.sections[0]]
    made = [(make.marker(name), recording.marker(name)) for name in below]
    return {sensor.name: (sensor, values) for sensor, values in made}


def registration_of(recording: Recording, specimen: Specimen, section: str) -> Registration:
    """Find the laboratory in the base frame: by the base's markers, by its pose, or taken as the same.

    Args:
        recording: With positions in the laboratory.
        specimen: The arm.
        section: Name of its first section, the base.

    Raises:
        InputError: Markers or a frame of the base were recorded, and they cannot register it.
    """
    base = specimen.section(section)
    markers = [m for m in specimen.markers if m.section == base.name and m.name in recording.markers]
    if markers:
        rotation = from_quaternions(np.array(base.frame_quaternion))
        offsets = np.array([marker.offset_m for marker in markers])
        points = np.array(base.frame_origin_m) + offsets @ rotation.T
        measured = np.stack([recording.marker(marker.name) for marker in markers], axis=1)
        samples = max(int(np.isfinite(measured).all(axis=(1, 2)).sum()), 1)
        sigma = specimen.noise.marker_m * max(samples**-0.5, SYSTEMATIC_SHARE)
        return register(points, measured, sigma, f"{recording.name}, markers on the {base.name}")
    if base.name in recording.frames:
        return _registration_by_pose(recording, specimen, base.name)
    return Registration()


def _registration_by_pose(recording: Recording, specimen: Specimen, section: str) -> Registration:
    pose = recording.pose(section)
    valid = pose[np.isfinite(pose).all(axis=1)]
    if not len(valid):
        raise InputError(
            f"{recording.name}, frame_{section}",
            "holds no reading, so that nothing registers the laboratory",
            f"record the frame or three markers of the {section}, or remove its columns if all positions are "
            "in its frame",
        )
    base, mounted = specimen.section(section), specimen.calibration.frame(section)
    rest = from_quaternions(np.array(base.frame_quaternion))
    recorded = mean_rotation(from_quaternions(valid[:, 3:]))
    rotation = rest @ exp(np.array(mounted.misalignment_rad)) @ recorded.T
    origin = np.array(base.frame_origin_m) + rest @ np.array(mounted.offset_m)
    return Registration(rotation, origin - rotation @ valid[:, :3].mean(axis=0))
