"""What acts on the arm over time."""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Flags, Floats


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
        eigenstrains: What the material of each segment strains beside what loads and pressures make it
            strain: two bends, the twist [rad] and the elongation [m], shape (samples, segments, 4).
    """

    time: Floats
    pressures: Floats
    gravity: Floats
    wrenches: Floats
    couples: Floats
    base_rotation: Floats
    eigenstrains: Floats

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
            np.zeros((samples, segments, 4)),
        )

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.time)

    def plus(self, wrenches: Floats, couples: Floats) -> "Drive":
        """Add wrenches and couples."""
        return replace(self, wrenches=self.wrenches + wrenches, couples=self.couples + couples)

    def strained(self, eigenstrains: Floats) -> "Drive":
        """Add eigenstrains, shape (samples, segments, 4)."""
        return replace(self, eigenstrains=self.eigenstrains + eigenstrains)

    def at(self, chosen: Flags | NDArray[np.int64]) -> "Drive":
        """Return some samples."""
        return Drive(*(getattr(self, field.name)[chosen] for field in fields(self)))
