"""The stretch of each chamber, and its effective pressure under it.

A chamber runs from A, fixed to the section below it, to B, fixed to the one above. Between them the arm bends
along an arc of angle theta, that between the sections' axes, so that the chamber is stretched by

    s = |B - A| (theta/2) / sin(theta/2) / l - 1,

with l its length at rest. Its pressure acts like p (1 + g s): a winding keeps up the area that the pressure
pushes on, which the model's own chamber loses as it grows longer.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arc import arc_over_chord
from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.geometry import build_mesh
from softarm.estimator.model import Frames
from softarm.estimator.rotations import from_quaternions
from softarm.estimator.specimen import Section, Specimen


@dataclass(frozen=True)
class StretchLaw:
    """Where the chambers run, and how stretch changes their effective pressures; C chambers.

    Args:
        gain: g, relative growth of the effective pressure per unit of stretch.
        below: Section below each chamber, shape (C,).
        above: Section above it, shape (C,); the same where a chamber does not end at two sections, which
            leaves it unstretched.
        starts: A in the axes of the section below [m], shape (C, 3).
        ends: B in the axes of the section above [m], shape (C, 3).
        lengths: Lengths at rest [m], shape (C,).
        lower_axes: The arm's axis at rest in the axes of the section below, shape (C, 3).
        upper_axes: Likewise above, shape (C, 3).
    """

    gain: float
    below: Indices
    above: Indices
    starts: Floats
    ends: Floats
    lengths: Floats
    lower_axes: Floats
    upper_axes: Floats

    @classmethod
    def of(cls, specimen: Specimen, sections: tuple[str, ...]) -> "StretchLaw":
        """Lay out the chambers of a specimen, with the gain of its calibration.

        Args:
            specimen: Description.
            sections: Names of the model's sections.
        """
        mesh = build_mesh(specimen)
        entries = [specimen.section(name) for name in sections]
        count = len(specimen.chambers)
        below, above = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        starts, ends = np.zeros((count, 3)), np.zeros((count, 3))
        for k, chamber in enumerate(specimen.chambers):
            ends_at = specimen.section_above(chamber.from_m, sections)
            begins_at = specimen.section_below(chamber.to_m, sections)
            if ends_at is None or begins_at is None:
                continue
            below[k], above[k] = sections.index(ends_at), sections.index(begins_at)
            nodes = np.unique(mesh.surfaces[f"chamber_{chamber.index}"].facets)
            x, y = mesh.points[nodes, :2].mean(axis=0)
            starts[k] = _seen_from(entries[below[k]], np.array([x, y, chamber.from_m]))
            ends[k] = _seen_from(entries[above[k]], np.array([x, y, chamber.to_m]))
        axes = np.array([_rest(entry).T @ (0.0, 0.0, 1.0) for entry in entries]).reshape(-1, 3)
        gain = specimen.calibration.stretch_gain.value
        lengths = np.array([chamber.to_m - chamber.from_m for chamber in specimen.chambers])
        return cls(gain, below, above, starts, ends, lengths, axes[below], axes[above])

    def effective(self, pressures: Floats, stretches: Floats) -> Floats:
        """Return the pressures that would push as much on unstretched chambers [Pa], shape (..., C)."""
        acting: Floats = pressures * (1.0 + self.gain * stretches)
        return acting

    def stretches(self, frames: Frames) -> Floats:
        """Return the stretch of each chamber, shape (..., C)."""
        reach, angle = self._reach(frames), self._angle(frames)
        stretched: Floats = np.linalg.norm(reach, axis=-1) * arc_over_chord(angle)[0] / self.lengths - 1.0
        return np.where(self._known, stretched, 0.0)

    def rows(self, frames: Frames) -> Floats:
        """Differentiate the stretches by the stacked twists of the sections, shape (..., C, 6 sections)."""
        rotations, reach, angle = frames.rotations, self._reach(frames), self._angle(frames)
        chord = np.linalg.norm(reach, axis=-1)[..., None]
        ratio, over_angle = arc_over_chord(angle)
        along = reach / np.maximum(chord, 1e-12) * (ratio / self.lengths)[..., None]
        arms = (
            _turned(rotations, self.below, self.starts),
            _turned(rotations, self.above, self.ends),
        )
        lower, upper = self._axes(frames)
        # The cross product has the size sin(turn): with the ratio's slope it gives that by the cosine.
        by_cosine = -over_angle / np.sinc(angle / np.pi)
        bend = np.cross(lower, upper) * (chord[..., 0] * by_cosine / self.lengths)[..., None]
        sections = frames.positions.shape[-2]
        rows = np.zeros((*reach.shape[:-1], sections, 6))
        for k in np.flatnonzero(self._known):
            for section, sign, arm in ((self.below[k], -1.0, arms[0]), (self.above[k], 1.0, arms[1])):
                rows[..., k, section, :3] += sign * along[..., k, :]
                turned = np.cross(arm[..., k, :], along[..., k, :]) - bend[..., k, :]
                rows[..., k, section, 3:] += sign * turned
        return rows.reshape(*reach.shape[:-1], 6 * sections)

    @property
    def _known(self) -> NDArray[np.bool_]:
        return np.asarray(self.below != self.above)

    def _axes(self, frames: Frames) -> tuple[Floats, Floats]:
        return (
            _turned(frames.rotations, self.below, self.lower_axes),
            _turned(frames.rotations, self.above, self.upper_axes),
        )

    def _reach(self, frames: Frames) -> Floats:
        """Return B - A, shape (..., C, 3)."""
        start = frames.positions[..., self.below, :] + _turned(frames.rotations, self.below, self.starts)
        end = frames.positions[..., self.above, :] + _turned(frames.rotations, self.above, self.ends)
        return np.asarray(end - start)

    def _angle(self, frames: Frames) -> Floats:
        """Return the angle between the sections' axes [rad], shape (..., C)."""
        lower, upper = self._axes(frames)
        across = np.linalg.norm(np.cross(lower, upper), axis=-1)
        return np.asarray(np.arctan2(across, (lower * upper).sum(axis=-1)))


def _rest(entry: Section) -> Floats:
    return from_quaternions(np.array(entry.frame_quaternion))


def _seen_from(entry: Section, point: Floats) -> Floats:
    """Return a point at rest in the axes of a section [m], shape (3,)."""
    local: Floats = _rest(entry).T @ (point - np.array(entry.frame_origin_m))
    return local


def _turned(rotations: Floats, sections: Indices, vectors: Floats) -> Floats:
    """Turn a vector of each chamber with a section, shape (..., C, 3)."""
    return np.asarray(np.einsum("...cij,cj->...ci", rotations[..., sections, :, :], vectors))
