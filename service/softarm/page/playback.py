"""A recording with estimates, as the page shows it at one time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.recording import POSE_SUFFIXES, Recording
from softarm.estimator.specimen import Specimen
from softarm_client.messages import LoadEstimate, SectionPose

AXES = "xyz"


@dataclass(frozen=True)
class Instant:
    """What a recording holds at one time: of every stream the last reading up to then.

    Args:
        sections: Estimated poses, from base to tip.
        loads: Estimated forces.
        setpoints_pa: Set-points of the chambers; ``None`` before the first.
        measured_pa: Measured gauge pressures; ``None`` before the first.
        gauges_n: Pull of each force gauge.
    """

    sections: tuple[SectionPose, ...]
    loads: tuple[LoadEstimate, ...]
    setpoints_pa: tuple[float | None, ...]
    measured_pa: tuple[float | None, ...]
    gauges_n: dict[str, float | None]


class Playback:
    """Reads a recording at any of its times.

    Raises:
        InputError: It holds no estimated pose, or one of a section that the arm does not have.
    """

    def __init__(self, recording: Recording, specimen: Specimen) -> None:
        self.recording = recording
        """The recording."""
        self._chambers = range(len(specimen.chambers))
        self.sections = recording.members(r"estimate_frame_(.+)_qw")
        self.loads = recording.members(r"estimate_force_(.+)_x_n")
        if not self.sections:
            cure = "run softarm estimate RECORDING --out FILE.mcap, and give that file"
            raise InputError(recording.name, "holds no estimated poses", cure)
        foreign = set(self.sections) - {section.name for section in specimen.sections}
        if foreign:
            what = (
                f"was estimated with sections that the specimen does not have: {', '.join(sorted(foreign))}"
            )
            raise InputError(
                recording.name, what, "give the specimen that it was estimated with by --specimen"
            )
        ends = tuple(f"estimate_frame_{section}_qw" for section in self.sections)
        estimated = np.isfinite(recording.stack(ends)).all(axis=1)
        if not estimated.any():
            raise InputError(
                recording.name, "holds no estimate that converged", "calibrate the specimen first"
            )
        self.times = recording.time[estimated]
        """Times of the estimates [s], shape (estimates,)."""
        forces = (recording.stack(self._force_columns(load))[estimated] for load in self.loads)
        self.force_sizes = [np.linalg.norm(np.nan_to_num(force), axis=1) for force in forces]
        """Magnitude of each force at those times [N], each of shape (estimates,)."""

    @property
    def span_s(self) -> tuple[float, float]:
        """Time of the first and of the last estimate [s]."""
        return float(self.times[0]), float(self.times[-1])

    def at(self, time_s: float) -> Instant:
        """Return the newest values at a time of the recording [s]; at least those of the first estimate."""
        count = int(np.searchsorted(self.recording.time, max(time_s, self.times[0]), side="right"))
        return Instant(
            tuple(self._pose(section, count) for section in self.sections),
            tuple(self._load(load, count) for load in self.loads),
            tuple(self._last(f"pressure_cmd_{k}_pa", count) for k in self._chambers),
            tuple(self._last(f"pressure_{k}_pa", count) for k in self._chambers),
            {name: self._last(f"gauge_{name}_n", count) for name in self.recording.gauges},
        )

    @staticmethod
    def _force_columns(load: str) -> tuple[str, ...]:
        return tuple(f"estimate_force_{load}_{axis}_n" for axis in AXES)

    def _last(self, column: str, count: int) -> float | None:
        """Return the last finite value among the first samples of a column."""
        values = self.recording.columns.get(column)
        known = np.empty(0) if values is None else values[:count][np.isfinite(values[:count])]
        return float(known[-1]) if len(known) else None

    def _pose(self, section: str, count: int) -> SectionPose:
        pose = tuple(self._last(f"estimate_frame_{section}_{suffix}", count) for suffix in POSE_SUFFIXES)
        known = {"section": section, "position_m": pose[:3], "quaternion_wxyz": pose[3:]}
        return SectionPose.model_validate(known)

    def _load(self, load: str, count: int) -> LoadEstimate:
        """Return a force; a recording holds its standard deviations and no correlations."""
        force = tuple(self._last(column, count) or 0.0 for column in self._force_columns(load))
        deviations = [self._last(f"estimate_force_{load}_{axis}_std_n", count) for axis in AXES]
        covariance = np.full((3, 3), None)
        for axis, deviation in enumerate(deviations):
            covariance[axis, axis] = None if deviation is None else deviation**2
        known = {"section": load, "force_n": force, "covariance_n2": covariance.tolist()}
        return LoadEstimate.model_validate(known)


def bent_surface(rest_m: Floats, specimen: Specimen, sections: Sequence[SectionPose]) -> Floats:
    """Bend the surface along its sections: each section stays rigid, cubic curves join them.

    A recording holds the poses of the sections and not the surface between them. The centre line between two
    sections is the cubic Hermite curve that leaves and meets them along their axes, and the cross-sections
    along it rotate at a constant rate (slerp).

    Args:
        rest_m: Nodes of the unloaded arm [m], shape (nodes, 3).
        specimen: The arm.
        sections: Their poses, at least two.

    Returns:
        Nodes of the bent arm [m], shape (nodes, 3).
    """
    rest = {section.name: section for section in specimen.sections}
    heights, centres, rotations = [], [], []
    for pose in sections:
        section = rest[pose.section]
        rotation = _rotation(pose.quaternion_wxyz) * _rotation(section.frame_quaternion).inv()
        for height in sorted({section.from_m, section.to_m}):
            arm = np.array((0.0, 0.0, height)) - np.array(section.frame_origin_m)
            heights.append(height)
            centres.append(np.array(pose.position_m) + rotation.apply(arm))
            rotations.append(rotation)
    stacked = Rotation.concatenate(rotations)
    tangents = stacked.apply((0.0, 0.0, 1.0))
    at = np.clip(rest_m[:, 2], heights[0], heights[-1])
    across = rest_m - np.column_stack([np.zeros((len(at), 2)), at])
    return np.asarray(
        CubicHermiteSpline(heights, centres, tangents)(at) + Slerp(heights, stacked)(at).apply(across)
    )


def _rotation(quaternion_wxyz: Sequence[float]) -> Rotation:
    return Rotation.from_quat(quaternion_wxyz, scalar_first=True)
