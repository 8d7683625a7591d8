"""The motion of a recording as columns of plain vectors, one stream per sensor."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.recording import BEND_SUFFIXES, MARKER_SUFFIXES, POSE_SUFFIXES, Recording
from softarm.estimator.rotations import from_quaternions, log, mean_rotation
from softarm.estimator.specimen import Specimen

QUATERNION = 4
QUIET = {"m": 1e-3, "rad": np.radians(0.5)}
"""Spread of a column [m, rad] below which its sensor does not move, such as a body on the base."""
SPREAD = (5.0, 95.0)
"""Percentiles between which a spread is taken: a short event must not make a still body a moving one."""


@dataclass(frozen=True)
class SampledStream:
    """What one sensor of the motion recorded.

    Args:
        name: Name of the sensor, such as ``bend_tip``.
        kind: ``bend``, ``frame`` or ``marker``.
        target: Section or marker.
        columns: Its columns in the recording.
        values: Bend [rad], position [m] then rotation vector about its mean [rad], or position [m]; NaN where
            lost, shape (samples, size).
        units: Unit of each value.
    """

    name: str
    kind: str
    target: str
    columns: tuple[str, ...]
    values: Floats
    units: tuple[str, ...]

    @property
    def moving(self) -> Flags:
        """Which values move by more than a sensor at rest, shape (size,)."""
        return moving_columns(self.values, self.units)


def moving_columns(values: Floats, units: Sequence[str]) -> Flags:
    """Return which columns move by more than a sensor at rest, shape (columns,).

    Args:
        values: NaN where lost, shape (samples, columns).
        units: Unit of each column.
    """
    read = np.asarray(np.isfinite(values).any(axis=0))
    moving = read.copy()
    if read.any():
        low, high = np.nanpercentile(values[:, read], SPREAD, axis=0)
        moving[read] = (high - low) > np.array([QUIET[unit] for unit in units])[read]
    return moving


def streams_of(recording: Recording, specimen: Specimen) -> tuple[SampledStream, ...]:
    """Collect the streams of a recording's bends, frames and markers.

    Markers that the specimen does not name, such as one on the hook of a gauge, are no part of the arm.

    Orientations become rotation vectors about their mean, in the laboratory's axes: a rotation of the
    laboratory rotates them as it rotates positions.
    """
    bends = [_bend(recording, section) for section in recording.bends]
    frames = [_frame(recording, section) for section in recording.frames]
    described = {marker.name for marker in specimen.markers}
    markers = [_marker(recording, name) for name in recording.markers if name in described]
    return (*bends, *frames, *markers)


def _bend(recording: Recording, section: str) -> SampledStream:
    columns = _columns("bend", section, BEND_SUFFIXES)
    return SampledStream(f"bend_{section}", "bend", section, columns, recording.bend(section), ("rad", "rad"))


def _frame(recording: Recording, section: str) -> SampledStream:
    pose = recording.pose(section)
    valid = np.isfinite(pose).all(axis=1)
    vectors = np.full((len(pose), 3), np.nan)
    if valid.any():
        rotations = from_quaternions(pose[valid, 3:])
        vectors[valid] = log(rotations @ mean_rotation(rotations).T)
    values = np.column_stack([pose[:, :3], vectors])
    values[~valid] = np.nan
    units = ("m",) * 3 + ("rad",) * 3
    return SampledStream(
        f"frame_{section}", "frame", section, _columns("frame", section, POSE_SUFFIXES), values, units
    )


def _marker(recording: Recording, name: str) -> SampledStream:
    columns = _columns("marker", name, MARKER_SUFFIXES)
    return SampledStream(f"marker_{name}", "marker", name, columns, recording.marker(name), ("m", "m", "m"))


def _columns(kind: str, name: str, suffixes: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{kind}_{name}_{suffix}" for suffix in suffixes)
