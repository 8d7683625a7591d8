"""Position of one reflective marker on a section."""

from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.model import Frames
from softarm.estimator.rotations import skew
from softarm.estimator.sensing.measurement import Sensitivity, Unit, twist_rows
from softarm.estimator.sensing.registration import Registration


@dataclass(frozen=True)
class MarkerPosition:
    """A marker rigidly on a section, predicted at p + R offset with the section at p, R.

    The innovation is measured minus predicted in the base frame [m]; a reading is the position in the
    laboratory frame [m].

    Args:
        name: Name in reports.
        section: Index of the section.
        sigma: Standard deviation of each coordinate [m], one number or shape (3,).
        offset: Position in the section's frame [m], shape (3,).
        registration: Laboratory to base.
    """

    name: str
    section: int
    sigma: float | Floats
    offset: Floats
    registration: Registration = field(default_factory=Registration)

    size = 3
    units: ClassVar[tuple[Unit, ...]] = ("m", "m", "m")
    reading_size = 3
    parameter_names = ("offset_x", "offset_y", "offset_z")

    @property
    def parameters(self) -> Floats:
        """The offset [m], shape (3,)."""
        return self.offset

    def with_parameters(self, values: Floats) -> Self:
        """Return the same marker at another offset [m], shape (3,)."""
        return replace(self, offset=values)

    def predict(self, frames: Frames) -> Floats:
        """Return the position in the laboratory frame [m], shape (..., 3)."""
        return self.registration.to_laboratory(self._origin(frames) + self._arm(frames))

    def sensitivity(self, frames: Frames, reading: Floats) -> Sensitivity:
        """Compare a position in the laboratory frame [m], shape (..., 3), with the frames."""
        arm = self._arm(frames)
        innovation = self.registration.to_base(reading) - self._origin(frames) - arm
        identity = np.broadcast_to(np.eye(3), (*arm.shape[:-1], 3, 3))
        rows = np.concatenate([identity, -skew(arm)], axis=-1)
        return Sensitivity(innovation, twist_rows(frames, self.section, rows))

    def parameter_rows(self, frames: Frames, reading: Floats) -> Floats:  # noqa: ARG002
        """Return the derivative by the offset, shape (..., 3, 3)."""
        rows: Floats = frames.rotations[..., self.section, :, :]
        return rows

    def covariance(self, reading: Floats) -> Floats:
        """Return the covariance of the noise [m2], shape (..., 3, 3)."""
        return np.broadcast_to(np.diag(np.broadcast_to(self.sigma, 3) ** 2), (*np.shape(reading)[:-1], 3, 3))

    def _origin(self, frames: Frames) -> Floats:
        origin: Floats = frames.positions[..., self.section, :]
        return origin

    def _arm(self, frames: Frames) -> Floats:
        arm: Floats = frames.rotations[..., self.section, :, :] @ self.offset
        return arm
