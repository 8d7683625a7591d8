"""Orientation of a section, from an inertial unit or a motion-capture body."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats
from softarm.estimator.model import Frames
from softarm.estimator.rotations import (
    exp,
    from_quaternions,
    inverse_jacobian_kernel,
    inverse_left_jacobian,
    left_jacobian,
    quaternion_kernel,
    rotation_vector_kernel,
    to_quaternions,
)
from softarm.estimator.sensing.measurement import (
    Sensitivity,
    Unit,
    section_rotation,
    twist_rows,
)
from softarm.estimator.sensing.registration import Registration


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
    units: ClassVar[tuple[Unit, ...]] = ("rad", "rad", "rad")
    reading_size = 4
    parameter_names = ("misalignment_x", "misalignment_y", "misalignment_z")

    @property
    def parameters(self) -> Floats:
        """The misalignment [rad], shape (3,)."""
        return self.misalignment

    def with_parameters(self, values: Floats) -> Self:
        """Return the same sensor with another misalignment [rad], shape (3,)."""
        return replace(self, misalignment=values)

    def predict(self, frames: Frames) -> Floats:
        """Return the quaternion in the laboratory frame, shape (..., 4)."""
        return to_quaternions(self.registration.rotation.T @ self._rotation(frames))

    def sensitivity(self, frames: Frames, reading: Floats) -> Sensitivity:
        """Compare a quaternion in the laboratory frame, shape (..., 4), with the frames."""
        innovation, rotation = compare(self._rotation(frames), self._measured(reading))
        rows = np.concatenate([np.zeros_like(rotation), rotation], axis=-1)
        return Sensitivity(innovation, twist_rows(frames, self.section, rows))

    def parameter_rows(self, frames: Frames, reading: Floats) -> Floats:
        """Return the derivative by the misalignment, shape (..., 3, 3)."""
        innovation, _ = compare(self._rotation(frames), self._measured(reading))
        rows: Floats = inverse_left_jacobian(innovation) @ left_jacobian(-self.misalignment)
        return rows

    def covariance(self, reading: Floats) -> Floats:
        """Return the covariance of the noise [rad2], shape (..., 3, 3)."""
        leading = np.shape(reading)[:-1]
        return np.broadcast_to(self._noise, (*leading, 3, 3)) if leading else self._noise

    @cached_property
    def _noise(self) -> Floats:
        noise = np.diag(np.broadcast_to(self.sigma, 3) ** 2)
        noise.setflags(write=False)
        return noise

    @cached_property
    def _alignment(self) -> Floats:
        return exp(self.misalignment)

    def _rotation(self, frames: Frames) -> Floats:
        rotation: Floats = section_rotation(frames, self.section) @ self._alignment
        return rotation

    def _measured(self, reading: Floats) -> Floats:
        measured: Floats = self.registration.rotation @ from_quaternions(reading)
        return measured


def compare(predicted: Floats, measured: Floats) -> tuple[Floats, Floats]:
    """Compare rotations, shapes (..., 3, 3).

    Returns:
        log(H^T Y) with H predicted and Y measured, shape (..., 3), and the derivative of H's part in it by a
        rotation vector in the base frame, shape (..., 3, 3).
    """
    if predicted.shape != measured.shape:
        predicted, measured = np.broadcast_arrays(predicted, measured)
    shape = predicted.shape
    first = np.ascontiguousarray(predicted).reshape(-1, 3, 3)
    second = np.ascontiguousarray(measured).reshape(-1, 3, 3)
    innovations, rows = np.empty((len(first), 3)), np.empty((len(first), 3, 3))
    compare_kernel(first, second, innovations, rows)
    return innovations.reshape(shape[:-1]), rows.reshape(shape)


@njit(cache=True, nogil=True)
def compare_kernel(predicted: Floats, measured: Floats, innovations: Floats, rows: Floats) -> None:
    """Fill what ``compare`` gives, all with one leading axis."""
    relative, quaternion, inverse = np.empty((1, 3, 3)), np.empty((1, 4)), np.empty((1, 3, 3))
    for n in range(predicted.shape[0]):
        h = predicted[n]
        for i in range(3):
            for k in range(3):
                relative[0, i, k] = (
                    h[0, i] * measured[n, 0, k] + h[1, i] * measured[n, 1, k] + h[2, i] * measured[n, 2, k]
                )
        quaternion_kernel(relative, quaternion)
        rotation_vector_kernel(quaternion, innovations[n : n + 1])
        inverse_jacobian_kernel(innovations[n : n + 1], inverse)
        for i in range(3):
            for k in range(3):
                rows[n, i, k] = (
                    inverse[0, i, 0] * h[k, 0] + inverse[0, i, 1] * h[k, 1] + inverse[0, i, 2] * h[k, 2]
                )
