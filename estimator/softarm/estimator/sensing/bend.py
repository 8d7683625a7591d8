"""Two-axis bend of a section, from a flexible bend sensor or from two motion-capture bodies."""

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.model import Frames
from softarm.estimator.rotations import exp, left_jacobian, skew
from softarm.estimator.sensing.measurement import Sensitivity, Unit, section_rotation, transpose, twist_rows

MIRROR = np.diag([1.0, -1.0])


@dataclass(frozen=True)
class Bend:
    """Tilt of a section's z axis in the frame of another section: theta (cos phi, sin phi).

    With U the rotation of the reference and R that of the section, u and m the misalignments of what is
    mounted on them: d = (U exp(u))^T R exp(m) e_z, theta = angle(d, e_z), b = theta (d_x, d_y) / sin(theta).
    The prediction is scale * (Rot(in_plane) M b) + bias, M the mirror y -> -y where the axes are recorded
    left-handed. A reading is the two angles [rad].

    Args:
        name: Name in reports.
        section: Index of the section.
        sigma: Standard deviation of each angle [rad], one number or shape (2,).
        reference: Index of the section in whose frame the tilt is measured; ``None`` is the clamp.
        in_plane: Rotation of the recorded axes about the reference's z axis [rad].
        reference_tilt: Misalignment u of the body on the reference about its x and y axes [rad], shape (2,).
        section_tilt: Misalignment m of the body on the section about its x and y axes [rad], shape (2,).
        scale: Factor of each recorded angle, shape (2,).
        bias: Offset of each recorded angle [rad], shape (2,).
        mirrored: Whether the recorded axes are left-handed.
    """

    name: str
    section: int
    sigma: float | Floats
    reference: int | None = None
    in_plane: float = 0.0
    reference_tilt: Floats = field(default_factory=lambda: np.zeros(2))
    section_tilt: Floats = field(default_factory=lambda: np.zeros(2))
    scale: Floats = field(default_factory=lambda: np.ones(2))
    bias: Floats = field(default_factory=lambda: np.zeros(2))
    mirrored: bool = False

    registration = None
    size = 2
    units: ClassVar[tuple[Unit, ...]] = ("rad", "rad")
    reading_size = 2
    parameter_names = (
        "in_plane",
        "reference_tilt_x",
        "reference_tilt_y",
        "section_tilt_x",
        "section_tilt_y",
        "scale_x",
        "scale_y",
        "bias_x",
        "bias_y",
    )

    @property
    def parameters(self) -> Floats:
        """In-plane rotation, tilts of reference and section, scales, biases, shape (9,)."""
        return np.concatenate(
            [[self.in_plane], self.reference_tilt, self.section_tilt, self.scale, self.bias]
        )

    def with_parameters(self, values: Floats) -> Self:
        """Return the same sensor with other alignment parameters, shape (9,)."""
        return replace(
            self,
            in_plane=float(values[0]),
            reference_tilt=values[1:3],
            section_tilt=values[3:5],
            scale=values[5:7],
            bias=values[7:9],
        )

    def predict(self, frames: Frames) -> Floats:
        """Return the two angles [rad], shape (..., 2)."""
        bend: Floats = bend_of(self._direction(frames)) @ self._frame().T * self.scale + self.bias
        return bend

    def sensitivity(self, frames: Frames, reading: Floats) -> Sensitivity:
        """Compare two angles [rad], shape (..., 2), with the frames."""
        direction = self._direction(frames)
        shape = self.scale[:, None] * self._frame() @ bend_jacobian(direction)
        reference = section_rotation(frames, self.reference) @ exp(_axes(self.reference_tilt))
        # A rotation vector w of the section changes d by U^T (w x U d), one of the reference by its opposite.
        rotated = shape @ -skew(direction) @ transpose(reference)
        rows = np.concatenate([np.zeros_like(rotated), rotated], axis=-1)
        twists = twist_rows(frames, self.section, rows)
        twists = twists - twist_rows(frames, self.reference, rows)
        predicted = bend_of(direction) @ self._frame().T * self.scale + self.bias
        return Sensitivity(reading - predicted, twists)

    def parameter_rows(self, frames: Frames, reading: Floats) -> Floats:  # noqa: ARG002
        """Return the derivative by the alignment parameters, shape (..., 2, 9)."""
        direction = self._direction(frames)
        bend = bend_of(direction)
        shape = self.scale[:, None] * self._frame() @ bend_jacobian(direction)
        quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
        unscaled = bend @ self._frame().T
        rows = np.zeros((*bend.shape[:-1], 2, 9))
        rows[..., 0] = unscaled @ quarter.T * self.scale
        reference, section = _axes(self.reference_tilt), _axes(self.section_tilt)
        right = left_jacobian(-reference)
        rows[..., 1:3] = (shape @ skew(direction) @ right)[..., :2]
        relative = transpose(self._reference(frames)) @ section_rotation(frames, self.section)
        left = -skew(exp(section)[:, 2]) @ left_jacobian(section)
        rows[..., 3:5] = (shape @ relative @ left)[..., :2]
        rows[..., 0, 5] = unscaled[..., 0]
        rows[..., 1, 6] = unscaled[..., 1]
        rows[..., 0, 7] = rows[..., 1, 8] = 1.0
        return rows

    def covariance(self, reading: Floats) -> Floats:
        """Return the covariance of the noise [rad2], shape (..., 2, 2)."""
        return np.broadcast_to(np.diag(np.broadcast_to(self.sigma, 2) ** 2), (*np.shape(reading)[:-1], 2, 2))

    def _frame(self) -> Floats:
        cosine, sine = np.cos(self.in_plane), np.sin(self.in_plane)
        rotation = np.array([[cosine, -sine], [sine, cosine]])
        return rotation @ MIRROR if self.mirrored else rotation

    def _reference(self, frames: Frames) -> Floats:
        rotation: Floats = section_rotation(frames, self.reference) @ exp(_axes(self.reference_tilt))
        return rotation

    def _direction(self, frames: Frames) -> Floats:
        axis = section_rotation(frames, self.section) @ exp(_axes(self.section_tilt))[:, 2]
        direction: Floats = (transpose(self._reference(frames)) @ axis[..., None])[..., 0]
        return direction


def bend_of(direction: Floats) -> Floats:
    """Return the bend theta (cos phi, sin phi) [rad], shape (..., 2), of unit vectors, shape (..., 3)."""
    bend: Floats = _ratio(direction)[0][..., None] * direction[..., :2]
    return bend


def bend_jacobian(direction: Floats) -> Floats:
    """Return the derivative of ``bend_of`` along the unit sphere, shape (..., 2, 3)."""
    ratio, slope = _ratio(direction)
    across = direction[..., :2]
    jacobian = np.zeros((*direction.shape[:-1], 2, 3))
    jacobian[..., :2] = slope[..., None, None] * across[..., :, None] * across[..., None, :]
    jacobian[..., 0, 0] += ratio
    jacobian[..., 1, 1] += ratio
    # On the unit sphere d theta / d d_z = -sin(theta).
    jacobian[..., 2] = -across
    return jacobian


def _ratio(direction: Floats) -> tuple[Floats, Floats]:
    """Return theta / sin(theta) and (sin cos - theta) / sin^3, by series near zero."""
    sine = np.hypot(direction[..., 0], direction[..., 1])
    angle = np.arctan2(sine, direction[..., 2])
    # Near zero alone: near pi the ratio does grow without bound.
    small = (sine < 1e-3) & (direction[..., 2] > 0)
    safe = np.where(small, 1.0, sine)
    ratio = np.where(small, 1.0 + sine**2 / 6.0, angle / safe)
    slope = np.where(small, -2.0 / 3.0 - sine**2 / 5.0, (safe * direction[..., 2] - angle) / safe**3)
    return ratio, slope


def _axes(tilt: Floats) -> Floats:
    """Extend a tilt about x and y to a rotation vector."""
    return np.array([tilt[0], tilt[1], 0.0])
