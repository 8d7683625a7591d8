"""How a changed material answers the vibrations of an arm: by equivalent linearisation."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from softarm.estimator.arrays import Flags, Floats

SOFTEST, STIFFEST = 0.2, 5.0
"""Factors on a stiffness beyond which a law is far from linear in the bends of a vibration."""


@dataclass(frozen=True)
class Swing:
    """The bends of an arm's vibration.

    Args:
        bends: By which it differs from the arm at rest under the same drive, shape (samples, segments, 2);
            zero where either is not known.
        rates: Their derivatives by time, shape (samples, segments, 2).
    """

    bends: Floats
    rates: Floats

    @classmethod
    def of(cls, clock: Floats, vibrating: Floats, still: Floats, known: Flags) -> "Swing":
        """Compare the strains of a vibrating arm with those at rest.

        Args:
            clock: Time of each sample [s], shape (samples,).
            vibrating: Strains, shape (samples, segments, 4).
            still: The same at rest.
            known: Samples at which both are known, shape (samples,).
        """
        bends = np.where(known[:, None, None], (vibrating - still)[..., :2], 0.0)
        # Differences of samples fall short by half at the second lowest frequency; a spline does not.
        rates = CubicSpline(clock, bends)(clock, 1) if len(clock) > 1 else np.zeros_like(bends)
        return cls(bends, rates)


@dataclass(frozen=True)
class Resistance:
    """How a segment resists the bends of vibrations.

    Args:
        segment: Its number.
        stiffness: Factor on its stiffness.
        damping_time: Damping over the stiffness [s].
    """

    segment: int
    stiffness: float
    damping_time: float

    @property
    def bends(self) -> slice:
        """Where its bends are among the strains of all segments."""
        return slice(4 * self.segment, 4 * self.segment + 2)


def resistances(
    swing: Swing, change: Floats, change_at_rest: Floats, segments: Flags, least_damping: float
) -> tuple[tuple[Resistance, ...], Floats]:
    """Find the stiffness and damping that come closest to what a law does to vibrations.

    A law turns the bends u of an arm into u + e(u). What a vibration x adds to e is g x + h x' by least
    squares over the recording (equivalent linearisation: T. K. Caughey, J. Acoust. Soc. Am. 35 (1963) 1706).
    Under a load q = K u such a segment strains by (1 + g) u + h u', to first order in h as one of the
    stiffness K / (1 + g) and the damping time -h / (1 + g).

    Args:
        swing: The vibration.
        change: What the law changes of the strains of the vibrating arm, shape (samples, segments, 4).
        change_at_rest: The same of the arm at rest.
        segments: Which segments the law changes, shape (segments,).
        least_damping: What is added to the damping over the stiffness at least [s], lest the arm gain energy.

    Returns:
        How each of these segments resists, and the change of the strains without that answer, of the shape of
        the change.
    """
    left, found = change.copy(), []
    for k in np.flatnonzero(segments):
        motion = np.stack([swing.bends[:, k].ravel(), swing.rates[:, k].ravel()])
        answer = np.nan_to_num(change[:, k, :2] - change_at_rest[:, k, :2]).ravel()
        slope, lag = (np.linalg.pinv(motion @ motion.T, hermitian=True) @ (motion @ answer)).tolist()
        stiffness = float(np.clip(1.0 / max(1.0 + slope, 1.0 / STIFFEST), SOFTEST, STIFFEST))
        damping = max(-lag * stiffness, least_damping / stiffness)
        slope, lag = 1.0 / stiffness - 1.0, -damping / stiffness
        left[:, k, :2] -= slope * swing.bends[:, k] + lag * swing.rates[:, k]
        found.append(Resistance(int(k), stiffness, damping))
    return tuple(found), left
