"""Where the arm's surface is along its length, between the sections whose poses a model predicts.

The axis of a segment is the cubic through the poses of its ends (Hermite). By virtual work a force on it acts
on both sections as the nodal loads of a beam do, which move the ends of a uniform segment as the force itself
does.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.simulation import Segments

POINTS = 4
"""Points of a segment."""


@dataclass(frozen=True)
class Surface:
    """Points of the axis, and how far the surface is from them.

    Args:
        along: Direction of the arm at rest in the frame of each section, shape (sections, 3).
        section_radii: Outer radius at the origin of each section [m], shape (sections,).
        sections: First section at or below each point, shape (points,).
        by_position: Weights of the sections' origins, shape (points, sections).
        by_axis: Weights of their directions [m], shape (points, sections).
        clamped: What the clamp contributes [m], shape (points, 3).
        radii: Outer radius at each point [m], shape (points,).
    """

    along: Floats
    section_radii: Floats
    sections: Indices
    by_position: Floats
    by_axis: Floats
    clamped: Floats
    radii: Floats

    @classmethod
    def of(cls, segments: Segments, end: float, outer_radii: Callable[[Floats], Floats]) -> "Surface":
        """Spread points along the segments, and one at the arm's end.

        Args:
            segments: The segments.
            end: Height of the arm's end at rest [m].
            outer_radii: Gives the outer radius at some heights [m].
        """
        heights, units = segments.rest.positions[:, 2], np.eye(len(segments.rest.positions))
        shares = (np.arange(POINTS) + 0.5) / POINTS
        lower, bent = shares**2 * (3.0 - 2.0 * shares), shares * (1.0 - shares) ** 2
        parts = []
        for above, below in segments.neighbours:
            start = heights[above] if above >= 0 else 0.0
            length = heights[below] - start
            upper = units[above] if above >= 0 else np.zeros(len(heights))
            by_position = np.outer(1.0 - lower, upper) + np.outer(lower, units[below])
            by_axis = length * (np.outer(bent, upper) - np.outer(bent[::-1], units[below]))
            clamped = np.outer(bent, [0.0, 0.0, length]) if above < 0 else np.zeros((POINTS, 3))
            parts.append((np.full(POINTS, below), by_position, by_axis, clamped, start + shares * length))
        last = segments.below[-1]
        tip = (end - heights[last]) * units[[last]]
        parts.append((np.array([last]), units[[last]], tip, np.zeros((1, 3)), np.array([end])))
        sections, by_position, by_axis, clamped, at = (
            np.concatenate(part) for part in zip(*parts, strict=True)
        )
        along = segments.rest.rotations[:, 2]
        return cls(along, outer_radii(heights), sections, by_position, by_axis, clamped, outer_radii(at))

    def down_to(self, section: int) -> "Surface":
        """Return the points down to a section."""
        chosen = self.sections <= section
        return replace(
            self,
            sections=self.sections[chosen],
            by_position=self.by_position[chosen],
            by_axis=self.by_axis[chosen],
            clamped=self.clamped[chosen],
            radii=self.radii[chosen],
        )

    def summed(self, masses: Floats) -> "Surface":
        """Return one point that is the sum of masses along the segments times their places [kg m].

        Args:
            masses: Of the segments, spread in proportion to their cross-sections [kg], shape (segments,).
        """
        areas = self.radii[:-1].reshape(len(masses), POINTS) ** 2
        weights = np.append(masses[:, None] * areas / areas.sum(axis=1, keepdims=True), 0.0)
        return replace(
            self,
            sections=self.sections[-1:],
            by_position=(weights @ self.by_position)[None],
            by_axis=(weights @ self.by_axis)[None],
            clamped=(weights @ self.clamped)[None],
            radii=self.radii[-1:],
        )

    def points(self, positions: Floats, rotations: Floats) -> Floats:
        """Return the points of the axis [m], shape (samples, points, 3).

        Args:
            positions: Origins of the sections [m], shape (samples, sections, 3).
            rotations: Rotations of the sections, shape (samples, sections, 3, 3).
        """
        points: Floats = self.by_position @ positions + self.by_axis @ self._directions(rotations)
        return points + self.clamped

    def gradients(self, rotations: Floats, normal: Floats) -> Floats:
        """Differentiate the points' places along a direction by the sections' twists.

        Args:
            rotations: Rotations of the sections, shape (samples, sections, 3, 3).
            normal: The direction, shape (3,).

        Returns:
            Shape (samples, points, sections, 6).
        """
        gradients = np.empty((len(rotations), *self.by_position.shape, 6))
        gradients[..., :3] = self.by_position[:, :, None] * normal
        gradients[..., 3:] = self.by_axis[:, :, None] * np.cross(self._directions(rotations), normal)[:, None]
        return gradients

    def _directions(self, rotations: Floats) -> Floats:
        """Return the directions of the arm at its sections, shape (samples, sections, 3)."""
        return np.asarray((rotations @ self.along[..., None])[..., 0])
