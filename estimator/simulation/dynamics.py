"""Whether motion matters: natural frequencies of the arm, and how far a run departs from quasi-statics.

With C the compliance of the sections against forces at their origins and M their masses, the modes of
M x'' + C^-1 x = 0 have omega^-2 = eigenvalues of M^1/2 C M^1/2. Masses gathered at the sections (half of a
segment's at either end) represent the first bending modes; the inertia of rotation is left out.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.simulation.drive import Response
from estimator.simulation.filters import second_order

Floats = NDArray[np.float64]

LIGHTEST = 1e-6
"""Smallest share of the slowest mode's omega^-2 at which a mode is given."""


def natural_frequencies(response: Response, masses: Floats, sample: int = 0) -> Floats:
    """Give the natural frequencies about the pose of one sample [Hz], rising.

    Args:
        response: Response with its derivatives.
        masses: Mass gathered at each section [kg], shape (sections,).
        sample: Which sample.
    """
    sections = len(masses)
    first = response.motion.shape[-1] - 3 - 6 * sections
    by_wrench = response.motion[sample, :, first : first + 6 * sections]
    compliance = by_wrench.reshape(sections, 6, sections, 6)[:, :3, :, :3].reshape(3 * sections, -1)
    root = np.sqrt(np.repeat(masses, 3))
    slowness = np.linalg.eigvalsh(root[:, None] * 0.5 * (compliance + compliance.T) * root)[::-1]
    kept = slowness[slowness > LIGHTEST * slowness[0]]
    frequencies: Floats = 1.0 / (2.0 * np.pi * np.sqrt(kept))
    return frequencies


@dataclass(frozen=True)
class Motion:
    """How far a run departs from quasi-statics.

    Args:
        frequency: Slowest natural frequency [Hz].
        departure: Largest root mean square, over the angles, of what inertia adds [rad].
        matters: Whether that exceeds the noise.
        resolved: Whether the samples are close enough to follow the slowest mode.
    """

    frequency: float
    departure: float
    matters: bool
    resolved: bool

    def tell(self) -> str:
        """Say in plain words whether quasi-statics is enough."""
        size = f"inertia at {self.frequency:.1f} Hz adds {np.degrees(self.departure):.3f} degrees rms"
        if not self.matters:
            return f"Quasi-static is enough: {size}, below the noise."
        if not self.resolved:
            return f"Motion matters ({size}), but the samples are too far apart to follow it."
        return f"Motion matters: {size}."


def judge_motion(
    time: Floats, angles: Floats, frequency: float, noise: float, damping_ratio: float = 0.05
) -> Motion:
    """Compare quasi-static angles with those of an arm that swings at a frequency.

    Args:
        time: Seconds, shape (samples,).
        angles: Quasi-static angles [rad], shape (samples, angles).
        frequency: Slowest natural frequency [Hz].
        noise: Standard deviation of an angle [rad].
        damping_ratio: Share of critical damping.
    """
    inertia = 1.0 / (2.0 * np.pi * frequency)
    moving, _ = second_order(time, angles, inertia, 2.0 * damping_ratio * inertia, ())
    departure = float(np.sqrt(((moving - angles) ** 2).mean(axis=0)).max())
    resolved = bool(np.median(np.diff(time)) < 0.25 / frequency)
    return Motion(frequency, departure, departure > noise, resolved)
