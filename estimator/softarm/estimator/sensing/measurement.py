"""What every measurement answers: its prediction, innovation, sensitivities and noise.

A reading y is compared with the model in the tangent space of its kind. With h the prediction, the
innovation is r = y (-) h and its sensitivities are those of the prediction, so that a twist dx of the
sections changes r by -rows dx. Every function takes any number of leading axes (samples in time).
"""

from dataclasses import dataclass
from typing import Literal, Protocol, Self

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.model import Frames
from softarm.estimator.rotations import skew
from softarm.estimator.sensing.registration import Registration

Unit = Literal["m", "rad"]


@dataclass(frozen=True)
class Sensitivity:
    """An innovation and the derivatives of the prediction behind it.

    Args:
        innovation: Measured minus predicted, shape (..., size); NaN where the reading is absent.
        twists: Derivative by the stacked section twists, shape (..., size, 6 sections).
    """

    innovation: Floats
    twists: Floats


class Measurement(Protocol):
    """One sensor: immutable, its alignment among its fields."""

    @property
    def name(self) -> str:
        """Name in reports, such as ``bend_tip``."""

    @property
    def size(self) -> int:
        """Number of entries of the innovation."""

    @property
    def units(self) -> tuple[Unit, ...]:
        """Unit of each entry of the innovation."""

    @property
    def reading_size(self) -> int:
        """Number of entries of a reading."""

    @property
    def registration(self) -> Registration | None:
        """Laboratory to base, where readings are given in the laboratory frame."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the alignment parameters."""

    @property
    def parameters(self) -> Floats:
        """Values of the alignment parameters."""

    def with_parameters(self, values: Floats) -> Self:
        """Return the same sensor with other alignment parameters."""

    def predict(self, frames: Frames) -> Floats:
        """Return the reading that the frames would cause, shape (..., reading_size)."""

    def sensitivity(self, frames: Frames, reading: Floats) -> Sensitivity:
        """Compare a reading, shape (..., reading_size), with the frames."""

    def parameter_rows(self, frames: Frames, reading: Floats) -> Floats:
        """Return the derivative of the prediction by the alignment, shape (..., size, parameters)."""

    def covariance(self, reading: Floats) -> Floats:
        """Return the covariance of the noise of a reading, shape (..., size, size)."""


def twist_rows(frames: Frames, section: int | None, rows: Floats) -> Floats:
    """Place the derivative by one section's twist among those of all, shape (..., size, 6 sections).

    Args:
        frames: Frames of all sections.
        section: Index of the section; ``None`` stands for the clamp, which does not move.
        rows: Derivative by the section's translation and rotation, shape (..., size, 6).
    """
    sections = frames.positions.shape[-2]
    stacked = np.zeros((*rows.shape[:-1], 6 * sections))
    if section is not None:
        stacked[..., 6 * section : 6 * section + 6] = rows
    return stacked


def section_rotation(frames: Frames, section: int | None) -> Floats:
    """Return the rotation of a section, or the identity for the clamp, shape (..., 3, 3)."""
    if section is None:
        return np.broadcast_to(np.eye(3), (*frames.rotations.shape[:-3], 3, 3))
    rotation: Floats = frames.rotations[..., section, :, :]
    return rotation


def rigid_motion(frames: Frames) -> Floats:
    """Return the stacked section twists of a rigid motion (v, w) of all, shape (..., 6 sections, 6)."""
    sections = frames.positions.shape[-2]
    motion = np.zeros((*frames.positions.shape[:-2], sections, 6, 6))
    motion[...] = np.eye(6)
    motion[..., :3, 3:] = -skew(frames.positions)
    return motion.reshape(*frames.positions.shape[:-2], 6 * sections, 6)


def transpose(matrices: Floats) -> Floats:
    """Swap the last two axes."""
    return np.swapaxes(matrices, -1, -2)
