"""Orientation of a section, from an inertial unit or a motion-capture body."""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from estimator.rotations import (
    exp,
    from_quaternions,
    inverse_left_jacobian,
    left_jacobian,
    log,
    to_quaternions,
)
from estimator.sensing.measurement import (
    Scene,
    Sensitivity,
    no_load_rows,
    section_rotation,
    transpose,
    twist_rows,
)
from estimator.sensing.registration import Registration

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Orientation:
    """Orientation of a body fixed to a section.

    The predicted orientation in the base frame is H = R exp(m), R the section's rotation and m the mounting
    misalignment. The innovation is log(H^T Y) in the axes of the body, Y the measured rotation in the base
    frame. A reading is a quaternion (w, x, y, z) in the laboratory frame.

    Args:
        name: Name in reports.
        section: Index of the section.
        sigma: Standard deviation about each axis [rad], one number or shape (3,).
        misalignment: Mounting rotation m of the body on the section [rad], shape (3,).
        registration: Laboratory to base.
    """

    name: str
    section: int
    sigma: float | Floats
    misalignment: Floats = field(default_factory=lambda: np.zeros(3))
    registration: Registration = field(default_factory=Registration)

    size = 3
    reading_size = 4
    parameter_names = ("misalignment_x", "misalignment_y", "misalignment_z")

    @property
    def parameters(self) -> Floats:
        """The misalignment [rad], shape (3,)."""
        return self.misalignment

    def with_parameters(self, values: Floats) -> Self:
        """Give the same sensor with another misalignment [rad], shape (3,)."""
        return replace(self, misalignment=values)

    def predict(self, scene: Scene) -> Floats:
        """Give the quaternion in the laboratory frame, shape (..., 4)."""
        return to_quaternions(self.registration.rotation.T @ self._rotation(scene))

    def sensitivity(self, scene: Scene, reading: Floats) -> Sensitivity:
        """Compare a quaternion in the laboratory frame, shape (..., 4), with the scene."""
        predicted = self._rotation(scene)
        innovation = self._innovation(predicted, reading)
        rotation = inverse_left_jacobian(innovation) @ transpose(predicted)
        rows = np.concatenate([np.zeros_like(rotation), rotation], axis=-1)
        return Sensitivity(
            innovation, twist_rows(scene.frames, self.section, rows), no_load_rows(scene, self.size)
        )

    def parameter_rows(self, scene: Scene, reading: Floats) -> Floats:
        """Give the derivative by the misalignment, shape (..., 3, 3)."""
        innovation = self._innovation(self._rotation(scene), reading)
        rows: Floats = inverse_left_jacobian(innovation) @ left_jacobian(-self.misalignment)
        return rows

    def covariance(self, reading: Floats) -> Floats:
        """Give the covariance of the noise [rad2], shape (..., 3, 3)."""
        return np.broadcast_to(np.diag(np.broadcast_to(self.sigma, 3) ** 2), (*np.shape(reading)[:-1], 3, 3))

    def _rotation(self, scene: Scene) -> Floats:
        rotation: Floats = section_rotation(scene.frames, self.section) @ exp(self.misalignment)
        return rotation

    def _innovation(self, predicted: Floats, reading: Floats) -> Floats:
        return log(transpose(predicted) @ self.registration.rotation @ from_quaternions(reading))
