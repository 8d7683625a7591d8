"""Pose of a section from motion capture."""

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.model import Frames
from softarm.estimator.sensing.marker import MarkerPosition
from softarm.estimator.sensing.measurement import Sensitivity, Unit
from softarm.estimator.sensing.orientation import Orientation
from softarm.estimator.sensing.registration import Registration


@dataclass(frozen=True)
class MeasuredPose:
    """Position and orientation of a body fixed to a section.

    With the section at p, R the body is predicted at p + R offset, R exp(misalignment). The innovation is
    measured minus predicted position [m] in the base frame, then the orientation's innovation [rad] in the
    axes of the body. A reading is a position [m] and a quaternion (w, x, y, z) in the laboratory frame.

    Args:
        name: Name in reports.
        section: Index of the section.
        position_sigma: Standard deviation of each coordinate [m], one number or shape (3,).
        rotation_sigma: Standard deviation about each axis [rad], one number or shape (3,).
        offset: Origin of the body in the section's frame [m], shape (3,).
        misalignment: Mounting rotation of the body on the section [rad], shape (3,).
        registration: Laboratory to base.
    """

    name: str
    section: int
    position_sigma: float | Floats
    rotation_sigma: float | Floats
    offset: Floats = field(default_factory=lambda: np.zeros(3))
    misalignment: Floats = field(default_factory=lambda: np.zeros(3))
    registration: Registration = field(default_factory=Registration)

    size = 6
    units: ClassVar[tuple[Unit, ...]] = ("m", "m", "m", "rad", "rad", "rad")
    reading_size = 7
    parameter_names = ("offset_x", "offset_y", "offset_z", *Orientation.parameter_names)

    @property
    def parameters(self) -> Floats:
        """The offset [m], then the misalignment [rad], shape (6,)."""
        return np.concatenate([self.offset, self.misalignment])

    def with_parameters(self, values: Floats) -> Self:
        """Return the same sensor with another offset and misalignment, shape (6,)."""
        return replace(self, offset=values[:3], misalignment=values[3:])

    def predict(self, frames: Frames) -> Floats:
        """Return position and quaternion in the laboratory frame, shape (..., 7)."""
        return np.concatenate([self._marker().predict(frames), self._orientation().predict(frames)], axis=-1)

    def sensitivity(self, frames: Frames, reading: Floats) -> Sensitivity:
        """Compare position and quaternion in the laboratory frame, shape (..., 7), with the frames."""
        moved = self._marker().sensitivity(frames, reading[..., :3])
        rotated = self._orientation().sensitivity(frames, reading[..., 3:])
        return Sensitivity(
            np.concatenate([moved.innovation, rotated.innovation], axis=-1),
            np.concatenate([moved.twists, rotated.twists], axis=-2),
        )

    def parameter_rows(self, frames: Frames, reading: Floats) -> Floats:
        """Return the derivative by offset and misalignment, shape (..., 6, 6)."""
        rotation = frames.rotations[..., self.section, :, :]
        rows = np.zeros((*rotation.shape[:-2], 6, 6))
        rows[..., :3, :3] = rotation
        rows[..., 3:, 3:] = self._orientation().parameter_rows(frames, reading[..., 3:])
        return rows

    def covariance(self, reading: Floats) -> Floats:
        """Return the covariance of the noise, shape (..., 6, 6)."""
        position, rotation = np.broadcast_to(self.position_sigma, 3), np.broadcast_to(self.rotation_sigma, 3)
        diagonal = np.diag(np.concatenate([position, rotation]) ** 2)
        return np.broadcast_to(diagonal, (*np.shape(reading)[:-1], 6, 6))

    def _marker(self) -> MarkerPosition:
        return MarkerPosition(self.name, self.section, self.position_sigma, self.offset, self.registration)

    def _orientation(self) -> Orientation:
        return Orientation(self.name, self.section, self.rotation_sigma, self.misalignment, self.registration)
