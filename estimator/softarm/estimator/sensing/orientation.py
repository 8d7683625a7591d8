"""Orientation of a section, from an inertial unit or a motion-capture body."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.model import Frames
from softarm.estimator.rotations import (
    exp,
    flat,
    inverse_jacobian_kernel,
    inverse_left_jacobian,
    left_jacobian,
    matrix_kernel,
    quaternion_kernel,
    rotation_vector_kernel,
    to_quaternions,
)
from softarm.estimator.sensing.measurement import Sensitivity, Unit
from softarm.estimator.sensing.registration import Registration
from softarm.estimator.vectors import multiply


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
        rotations, leading = frames.rotations[..., self.section, :, :], np.shape(reading)[:-1]
        # One pose with many readings, or many poses with one.
        if rotations.shape[:-2] != leading:
            leading = np.broadcast_shapes(rotations.shape[:-2], leading)
            rotations = np.broadcast_to(rotations, (*leading, 3, 3))
            reading = np.broadcast_to(reading, (*leading, 4))
        width = 6 * frames.rotations.shape[-3]
        innovations, twists = np.empty((*leading, 3)), np.zeros((*leading, 3, width))
        alignment, laboratory = self.rotations
        sensitivity_kernel(
            flat(rotations, 9), alignment, laboratory, flat(reading, 4), 6 * self.section + 3,
            innovations.reshape(-1, 3), twists.reshape(-1, 3, width),
        )  # fmt: skip
        return Sensitivity(innovations, twists)

    def parameter_rows(self, frames: Frames, reading: Floats) -> Floats:
        """Return the derivative by the misalignment, shape (..., 3, 3)."""
        innovation = self.sensitivity(frames, reading).innovation
        rows: Floats = inverse_left_jacobian(innovation) @ left_jacobian(-self.misalignment)
        return rows

    def covariance(self, reading: Floats) -> Floats:
        """Return the covariance of the noise [rad2], shape (..., 3, 3)."""
        leading = np.shape(reading)[:-1]
        return np.broadcast_to(self._noise, (*leading, 3, 3)) if leading else self._noise

    @cached_property
    def _noise(self) -> Floats:
        noise = np.diag(np.broadcast_to(self.sigma, 3) ** 2)
        # Handed out to every caller, none of which may change it.
        noise.setflags(write=False)
        return noise

    @cached_property
    def rotations(self) -> tuple[Floats, Floats]:
        """Rotations of the body on the section and of the laboratory, each of shape (3, 3)."""
        return exp(self.misalignment), np.array(self.registration.rotation, dtype=np.float64, order="C")

    def _rotation(self, frames: Frames) -> Floats:
        rotation: Floats = frames.rotations[..., self.section, :, :] @ self.rotations[0]
        return rotation


@njit(cache=True, nogil=True)
def sensitivity_kernel(
    rotations: Floats,
    alignment: Floats,
    laboratory: Floats,
    quaternions: Floats,
    column: int,
    innovations: Floats,
    twists: Floats,
) -> None:
    """Fill log(H^T Y) and the derivative of H's part in it by a rotation vector in the base frame.

    Args:
        rotations: Of the section, shape (n, 3, 3).
        alignment: Rotation of the body on it, shape (3, 3).
        laboratory: Rotation of the laboratory, shape (3, 3).
        quaternions: Readings, shape (n, 4).
        column: First of the columns of the section's rotation.
        innovations: Filled, shape (n, 3).
        twists: Filled in these columns, shape (n, 3, 6 sections).
    """
    read, measured, predicted = np.empty((1, 3, 3)), np.empty((3, 3)), np.empty((3, 3))
    relative, quaternion, inverse = np.empty((1, 3, 3)), np.empty((1, 4)), np.empty((1, 3, 3))
    for n in range(len(rotations)):
        matrix_kernel(quaternions[n : n + 1], read)
        multiply(laboratory, read[0], measured)
        multiply(rotations[n], alignment, predicted)
        multiply(predicted.T, measured, relative[0])
        quaternion_kernel(relative, quaternion)
        rotation_vector_kernel(quaternion, innovations[n : n + 1])
        inverse_jacobian_kernel(innovations[n : n + 1], inverse)
        multiply(inverse[0], predicted.T, twists[n, :, column : column + 3])


@njit(cache=True, nogil=True)
def orientations_kernel(
    rotations: Floats,
    sections: Indices,
    alignments: Floats,
    laboratories: Floats,
    readings: Floats,
    innovation: Floats,
    twists: Floats,
) -> None:
    """Fill innovations and derivatives of several sensors at one instant.

    Args:
        rotations: Of all sections, shape (sections, 3, 3).
        sections: Section of each sensor, shape (sensors,).
        alignments: Rotation of its body on it, shape (sensors, 3, 3).
        laboratories: Rotation of its laboratory, shape (sensors, 3, 3).
        readings: Quaternions, shape (4 sensors,).
        innovation: Filled, shape (3 sensors,).
        twists: Zeros, filled, shape (3 sensors, 6 sections).
    """
    count = len(sections)
    quaternions = readings.reshape(count, 1, 4)
    innovations, rows = innovation.reshape(count, 1, 3), twists.reshape(count, 1, 3, twists.shape[1])
    for k in range(count):
        section = sections[k]
        sensitivity_kernel(
            rotations[section : section + 1], alignments[k], laboratories[k], quaternions[k], 6 * section + 3,
            innovations[k], rows[k],
        )  # fmt: skip
