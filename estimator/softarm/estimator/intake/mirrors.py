"""Mirrored axes of a laboratory: undone for frames and markers, and whether the two agree.

A frame and the markers of its section are one rigid body. With p, R the frame and m a marker whose place in
its section is o, R^T (m - p) is o up to how the body was defined, in one laboratory only.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softarm.estimator.arrays import Flags, Floats, Indices
from softarm.estimator.recording import Recording
from softarm.estimator.rotations import from_quaternions
from softarm.estimator.specimen import Specimen

AXES = "xyz"
SAMPLES = 60
AGREE = 0.02
"""Distance of markers from their places by the frames up to which both are in one laboratory [m]: bodies
are defined a few mm off their sections' axes."""
CLEARLY = 0.5
"""Share of the next explanation's distance that the best one's may be."""


def mirror_markers(recording: Recording, axis: int) -> Recording:
    """Return a recording whose markers are mirrored along one axis of the laboratory."""
    ends = f"_{AXES[axis]}_m"
    return _negated(recording, [n for n in recording.columns if n.startswith("marker_") and n.endswith(ends)])


def mirror_frames(recording: Recording, axis: int, *, whole: bool = False) -> Recording:
    """Return a recording whose frames are mirrored along one axis.

    Args:
        recording: With frames.
        axis: Number of the axis.
        whole: Whether orientations R are mirrored too, to M R M with the positions' mirror M; of their
            quaternions this reverses the sign of the components across the axis.
    """
    ends = [f"_{AXES[axis]}_m"]
    if whole:
        ends += [f"_q{letter}" for letter in AXES if letter != AXES[axis]]
    return _negated(
        recording, [n for n in recording.columns if n.startswith("frame_") and n.endswith(tuple(ends))]
    )


def marker_distance(recording: Recording, specimen: Specimen) -> float:
    """Return the mean distance of markers from their places by the frames [m]; NaN where no body has both."""
    distances = []
    for marker in specimen.markers:
        if marker.name in recording.markers and marker.section in recording.frames:
            pose, seen = recording.pose(marker.section), recording.marker(marker.name)
            rows = _some(np.isfinite(np.column_stack([pose, seen])).all(axis=1))
            if len(rows):
                rotations = from_quaternions(pose[rows, 3:])
                own = np.einsum("nji,nj->ni", rotations, seen[rows] - pose[rows, :3])
                distances.append(float(np.median(np.linalg.norm(own - np.array(marker.offset_m), axis=1))))
    return float(np.mean(distances)) if distances else np.nan


def clearly_least(distances: Floats) -> int | None:
    """Return which one of several distances [m] brings markers to the frames, if one alone does."""
    if not len(distances) or not np.isfinite(distances).all():
        return None
    best, *others = np.argsort(distances, kind="stable")
    least = distances[best]
    clear = least < AGREE and (not others or least < CLEARLY * distances[others[0]])
    return int(best) if clear else None


def shown_by_markers(recordings: Sequence[Recording], specimen: Specimen) -> int | None:
    """Return which one of several recordings has markers and frames in one laboratory, if one alone."""
    return clearly_least(np.array([marker_distance(one, specimen) for one in recordings]))


def _negated(recording: Recording, names: list[str]) -> Recording:
    return replace(
        recording, columns={**recording.columns, **{name: -recording.columns[name] for name in names}}
    )


def _some(valid: Flags | np.bool_) -> Indices:
    rows: Indices = np.flatnonzero(valid)
    if len(rows) > SAMPLES:
        rows = rows[np.linspace(0, len(rows) - 1, SAMPLES).astype(int)]
    return rows
