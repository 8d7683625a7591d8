"""What acts on the arm over time, and what it does."""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.model import Frames

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
        free: What the material of each segment strains beside what loads and pressures make it strain: two
            bends, the twist [rad] and the elongation [m], shape (samples, segments, 4).
    """

    time: Floats
    pressures: Floats
    gravity: Floats
    wrenches: Floats
    couples: Floats
    base_rotation: Floats
    free: Floats

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

    def strained(self, free: Floats) -> "Drive":
        """Add free strains, shape (samples, segments, 4)."""
        return replace(self, free=self.free + free)

    def at(self, chosen: Flags | NDArray[np.int64]) -> "Drive":
        """Take some samples."""
        return Drive(*(getattr(self, field.name)[chosen] for field in fields(self)))


@dataclass(frozen=True)
class Response:
    """What the arm does at each sample.

    Args:
        frames: Frames of the sections; arrays with a leading axis (samples,).
        strains: Generalised strains of the segments: rotation vector of the lower end seen from the upper
            one [rad], then elongation [m]; shape (samples, segments, 4).
        motion: Section twists per unit of each pressure, each component of the sections' wrenches and each
            component of gravity, shape (samples, 6 sections, chambers + 6 sections + 3).
        by_free: Section twists per unit of the segments' free strains, shape (samples, 6 sections,
            4 segments).
        converged: Where the model found its equilibrium, shape (samples,).
        by_stiffness: Section twists by the logarithm of each segment's stiffness, where the model gives
            them, shape (samples, 6 sections, segments).
        states: States of the model, to begin others with, where it can; shape (samples, ...).
    """

    frames: Frames
    strains: Floats
    motion: Floats
    by_free: Floats
    converged: Flags
    by_stiffness: Floats | None = None
    states: Floats | None = None

    @property
    def by_wrench(self) -> Floats:
        """Section twists per unit of the sections' wrenches, shape (samples, 6 sections, 6 sections)."""
        size = self.motion.shape[-2]
        first = self.motion.shape[-1] - 3 - size
        return self.motion[..., first : first + size]

    def at(self, chosen: Flags | NDArray[np.int64]) -> "Response":
        """Take some samples."""
        frames = Frames(self.frames.positions[chosen], self.frames.rotations[chosen])
        return Response(
            frames,
            self.strains[chosen],
            self.motion[chosen],
            self.by_free[chosen],
            self.converged[chosen],
            None if self.by_stiffness is None else self.by_stiffness[chosen],
            None if self.states is None else self.states[chosen],
        )
