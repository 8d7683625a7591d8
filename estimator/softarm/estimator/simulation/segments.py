"""Generalised strains of the segments: how each soft length bends, twists and stretches.

With R_a, R_b the rotations from rest of the sections above and below a segment and c the chord between
their origins, the strains are the rotation vector theta = log(R_a^T R_b) and the elongation
|c| f(beta) - rest length, f(beta) = (beta / 2) / sin(beta / 2), of an arc that bends by beta = |theta_xy|.
Loads conjugate to them act on the sections through the transposed derivative (virtual work).
"""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arc import arc_over_chord
from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.model import Frames
from softarm.estimator.rotations import inverse_left_jacobian, log
from softarm.estimator.specimen import Specimen

Neighbours = tuple[tuple[int, int], ...]
"""Section above and below each segment; -1 above stands for the clamp, which does not move."""


def neighbours_of(specimen: Specimen, sections: tuple[str, ...]) -> Neighbours:
    """Find the sections on either side of each segment.

    Raises:
        InputError: If no section of the model lies below a segment.
    """
    neighbours = []
    for part in specimen.segments:
        upper = specimen.section_above(part.from_m, sections)
        lower = specimen.section_below(part.to_m, sections)
        if lower is None:
            raise InputError("sections", f"none below segment {part.name!r}", "add a section at its end")
        neighbours.append((-1 if upper is None else sections.index(upper), sections.index(lower)))
    return tuple(neighbours)


@dataclass(frozen=True)
class Segments:
    """The segments between the sections whose frames a model predicts.

    Args:
        names: Names of the segments, base to tip.
        above: Section above each segment; -1 stands for the clamp, which does not move.
        below: Section below each segment.
        rest: Frames of the sections at rest.
    """

    names: tuple[str, ...]
    above: tuple[int, ...]
    below: tuple[int, ...]
    rest: Frames

    @classmethod
    def of(cls, specimen: Specimen, sections: tuple[str, ...], rest: Frames) -> "Segments":
        """Find the sections on either side of each segment.

        Raises:
            InputError: If no section of the model lies below a segment.
        """
        above, below = zip(*neighbours_of(specimen, sections), strict=True)
        return cls(tuple(part.name for part in specimen.segments), above, below, rest)

    @property
    def neighbours(self) -> Neighbours:
        """The sections above and below each segment."""
        return tuple(zip(self.above, self.below, strict=True))

    @property
    def count(self) -> int:
        """Number of segments."""
        return len(self.names)

    def _ends(self, frames: Frames) -> tuple[Floats, Floats, Floats]:
        """Return R_a, R_b, shape (..., segments, 3, 3), and the chords, shape (..., segments, 3)."""
        rotations = frames.rotations @ np.swapaxes(self.rest.rotations, -1, -2)
        upper = np.zeros((*rotations.shape[:-3], self.count, 3, 3))
        start = np.zeros(upper.shape[:-1])
        for g, a in enumerate(self.above):
            upper[..., g, :, :] = np.eye(3) if a < 0 else rotations[..., a, :, :]
            start[..., g, :] = 0.0 if a < 0 else frames.positions[..., a, :]
        lower = rotations[..., list(self.below), :, :]
        return upper, lower, frames.positions[..., list(self.below), :] - start

    @property
    def lengths(self) -> Floats:
        """Distances of the ends at rest [m], shape (segments,)."""
        lengths: Floats = np.linalg.norm(self._ends(self.rest)[2], axis=-1)
        return lengths

    def strains(self, frames: Frames) -> Floats:
        """Return the generalised strains, shape (..., segments, 4)."""
        upper, lower, chord = self._ends(frames)
        theta = log(np.swapaxes(upper, -1, -2) @ lower)
        arc = np.linalg.norm(chord, axis=-1) * arc_over_chord(np.hypot(theta[..., 0], theta[..., 1]))[0]
        return np.concatenate([theta, (arc - self.lengths)[..., None]], axis=-1)

    def rows(self, frames: Frames) -> Floats:
        """Differentiate the strains by the sections' twists, shape (..., segments, 4, 6 sections)."""
        upper, lower, chord = self._ends(frames)
        inward = np.swapaxes(upper, -1, -2)
        theta = log(inward @ lower)
        log_jacobian = inverse_left_jacobian(theta) @ inward
        beta = np.hypot(theta[..., 0], theta[..., 1])
        swell, over_beta = arc_over_chord(beta)
        length = np.linalg.norm(chord, axis=-1)
        along = chord * (swell / length)[..., None]
        bend = (length * over_beta)[..., None, None] * theta[..., None, :2] @ log_jacobian[..., :2, :]
        sections = self.rest.positions.shape[-2]
        rows = np.zeros((*theta.shape[:-1], 4, sections, 6))
        for g, (a, b) in enumerate(zip(self.above, self.below, strict=True)):
            for section, sign in ((a, -1.0), (b, 1.0)):
                if section >= 0:
                    rows[..., g, :3, section, 3:] += sign * log_jacobian[..., g, :, :]
                    rows[..., g, 3, section, 3:] += sign * bend[..., g, 0, :]
                    rows[..., g, 3, section, :3] += sign * along[..., g, :]
        return rows.reshape(*theta.shape[:-1], 4, 6 * sections)

    def wrenches(self, frames: Frames, couples: Floats) -> Floats:
        """Return the sections' wrenches, shape (..., sections, 6), that do the work of segment couples."""
        wrench: Floats = np.einsum("...gij,...gi->...j", self.rows(frames), couples)
        return wrench.reshape(*wrench.shape[:-1], -1, 6)
