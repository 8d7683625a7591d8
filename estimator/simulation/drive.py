"""What acts on the arm over time, and what it does."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estimator.model import Frames

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Drive:
    """What acts on the arm at each sample.

    Args:
        time: Seconds, strictly increasing, shape (samples,).
        pressures: Gauge pressures in the chambers [Pa], shape (samples, chambers).
        gravity: Gravitational acceleration in the base frame [m/s2], shape (samples, 3).
        wrenches: Force [N], then moment about the section's origin [N m], on each section in the base
            frame, shape (samples, sections, 6).
        couples: Self-equilibrated generalised loads of each segment, conjugate to its strains: two bending
            couples, torsion [N m], axial force [N]; shape (samples, segments, 4).
        base_rotation: Rotation vector of the base about its origin [rad], shape (samples, 3).
    """

    time: Floats
    pressures: Floats
    gravity: Floats
    wrenches: Floats
    couples: Floats
    base_rotation: Floats

    @classmethod
    def of(cls, time: Floats, pressures: Floats, gravity: Floats, sections: int, segments: int) -> "Drive":
        """Drive an arm by pressures and gravity, shape (3,) or (samples, 3), alone."""
        samples = len(time)
        return cls(
            np.asarray(time, dtype=np.float64),
            np.asarray(pressures, dtype=np.float64),
            np.array(np.broadcast_to(gravity, (samples, 3)), dtype=np.float64),
            np.zeros((samples, sections, 6)),
            np.zeros((samples, segments, 4)),
            np.zeros((samples, 3)),
        )

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.time)

    def plus(self, wrenches: Floats, couples: Floats) -> "Drive":
        """Add wrenches and couples."""
        return replace(self, wrenches=self.wrenches + wrenches, couples=self.couples + couples)


@dataclass(frozen=True)
class Response:
    """What the arm does at each sample.

    Args:
        frames: Frames of the sections; arrays with a leading axis (samples,).
        strains: Generalised strains of the segments: rotation vector of the lower end seen from the upper
            one [rad], then elongation [m]; shape (samples, segments, 4).
        motion: Section twists per unit of each pressure, each component of the sections' wrenches and each
            component of gravity, shape (samples, 6 sections, chambers + 6 sections + 3).
        converged: Where the model found its equilibrium, shape (samples,).
    """

    frames: Frames
    strains: Floats
    motion: Floats
    converged: Flags

    @property
    def by_wrench(self) -> Floats:
        """Section twists per unit of the sections' wrenches, shape (samples, 6 sections, 6 sections)."""
        size = self.motion.shape[-2]
        first = self.motion.shape[-1] - 3 - size
        return self.motion[..., first : first + size]
