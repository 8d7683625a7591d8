"""Where the arm's surface is along its length, between the sections whose poses a model predicts.

The axis of a segment is the cubic through the poses of its ends (Hermite). By virtual work a force on it acts
on both sections as the nodal loads of a beam do, which move the ends of a uniform segment as the force itself
does.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.simulation import Segments

POINTS = 4
"""Points of a segment, its lower end among them."""


@dataclass(frozen=True)
class Surface:
    """Points of the axis, and how far the surface is from them.

    Args:
        along: Direction of the arm at rest in the frame of each section, shape (sections, 3).
        by_position: Weights of the sections' origins, shape (points, sections).
        by_axis: Weights of their directions [m], shape (points, sections).
        clamped: What the clamp contributes [m], shape (points, 3).
        radii: Outer radius at each point [m], shape (points,).
    """

    along: Floats
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
        heights = segments.rest.positions[:, 2]
        by_position, by_axis, clamped, at = [], [], [], []
        for above, below in segments.neighbours:
            start = heights[above] if above >= 0 else 0.0
            length = heights[below] - start
            for share in np.arange(1, POINTS + 1) / POINTS:
                position, axis, fixed = np.zeros(len(heights)), np.zeros(len(heights)), np.zeros(3)
                lower = share**2 * (3.0 - 2.0 * share)
                position[below] = lower
                axis[below] = length * share**2 * (share - 1.0)
                bent = length * share * (1.0 - share) ** 2
                if above >= 0:
                    position[above], axis[above] = 1.0 - lower, bent
                else:
                    fixed[2] = bent
                by_position.append(position)
                by_axis.append(axis)
                clamped.append(fixed)
                at.append(start + share * length)
        last = segments.below[-1]
        by_position.append(np.eye(len(heights))[last])
        by_axis.append(np.eye(len(heights))[last] * (end - heights[last]))
        clamped.append(np.zeros(3))
        at.append(end)
        along = segments.rest.rotations[:, 2]
        return cls(
            along, np.array(by_position), np.array(by_axis), np.array(clamped), outer_radii(np.array(at))
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
