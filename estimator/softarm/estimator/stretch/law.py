"""The stretch of each chamber, and its effective pressure under it.

A chamber runs from A, fixed to the section below it, to B, fixed to the one above. Between them the arm bends
along an arc of angle theta, that between the sections' axes, so that the chamber is stretched by

    s = |B - A| (theta/2) / sin(theta/2) / l - 1,

with l its length at rest. Its pressure acts like p (1 + g s): a winding keeps up the area that the pressure
pushes on, which the model's own chamber loses as it grows longer.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

from softarm.estimator.arc import arc_kernel
from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.geometry import build_mesh
from softarm.estimator.model import Frames
from softarm.estimator.rotations import from_quaternions
from softarm.estimator.specimen import Section, Specimen
from softarm.estimator.vectors import cross, dot, rotate


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
        """Lay out the chambers of a specimen, with the gain of its calibration."""
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
        return self._evaluate(frames, 0)[0]

    def linearise(self, frames: Frames) -> tuple[Floats, Floats]:
        """Return the stretches and their derivatives by the stacked twists, shape (..., C, 6 sections)."""
        return self._evaluate(frames, 6 * frames.positions.shape[-2])

    def _evaluate(self, frames: Frames, width: int) -> tuple[Floats, Floats]:
        """Return the stretches and their derivatives, which have ``width`` columns: all or none."""
        leading, sections = frames.positions.shape[:-2], frames.positions.shape[-2]
        positions = np.ascontiguousarray(frames.positions).reshape(-1, sections, 3)
        rotations = np.ascontiguousarray(frames.rotations).reshape(-1, sections, 3, 3)
        count = len(self.lengths)
        stretches = np.zeros((len(positions), count))
        derivatives = np.zeros((len(positions), count, width))
        stretch_kernel(
            positions, rotations, self.below, self.above, self.starts, self.ends, self.lengths,
            self.lower_axes, self.upper_axes, stretches, derivatives,
        )  # fmt: skip
        return stretches.reshape(*leading, count), derivatives.reshape(*leading, count, width)


def _rest(entry: Section) -> Floats:
    return from_quaternions(np.array(entry.frame_quaternion))


def _seen_from(entry: Section, point: Floats) -> Floats:
    """Return a point at rest in the axes of a section [m], shape (3,)."""
    local: Floats = _rest(entry).T @ (point - np.array(entry.frame_origin_m))
    return local


@njit(cache=True, nogil=True)
def stretch_kernel(
    positions: Floats,
    rotations: Floats,
    below: Indices,
    above: Indices,
    starts: Floats,
    ends: Floats,
    lengths: Floats,
    lower_axes: Floats,
    upper_axes: Floats,
    stretches: Floats,
    rows: Floats,
) -> None:
    """Fill in the stretches of C chambers, and their derivatives where ``rows`` has columns.

    The sections have ``positions`` [m], shape (n, sections, 3), and ``rotations``; of the chambers, see
    ``StretchLaw``. ``stretches``, shape (n, C), and ``rows``, shape (n, C, 6 sections) or without columns,
    hold zeros to begin with.
    """
    start, end, reach = np.empty(3), np.empty(3), np.empty(3)
    lower, upper, across, rotated = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for n in range(positions.shape[0]):
        for c in range(len(lengths)):
            b, a = below[c], above[c]
            if a == b:
                continue
            rotate(rotations[n, b], starts[c], start)
            rotate(rotations[n, a], ends[c], end)
            for k in range(3):
                reach[k] = positions[n, a, k] + end[k] - positions[n, b, k] - start[k]
            rotate(rotations[n, b], lower_axes[c], lower)
            rotate(rotations[n, a], upper_axes[c], upper)
            cross(lower, upper, across)
            chord, sine = np.sqrt(dot(reach, reach)), np.sqrt(dot(across, across))
            angle = np.arctan2(sine, dot(lower, upper))
            ratio, over_angle = arc_kernel(angle)
            stretches[n, c] = chord * ratio / lengths[c] - 1.0
            if rows.shape[2] == 0:
                continue
            # The cross product has the size sin(angle): with the ratio's slope it gives that by the cosine.
            cardinal = np.sin(angle) / angle if angle > 0.0 else 1.0
            bend = -over_angle / cardinal * chord / lengths[c]
            along = ratio / lengths[c] / max(chord, 1e-12)
            for section, sign, arm in ((b, -1.0, start), (a, 1.0, end)):
                cross(arm, reach, rotated)
                for k in range(3):
                    rows[n, c, 6 * section + k] = sign * along * reach[k]
                    rows[n, c, 6 * section + 3 + k] = sign * (along * rotated[k] - bend * across[k])
