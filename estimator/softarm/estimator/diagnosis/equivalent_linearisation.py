"""Equivalent linearisation: the stiffness and damping of a changed material in a vibrating arm."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from softarm.estimator.arrays import Flags, Floats

SOFTEST, STIFFEST = 0.2, 5.0
"""Factors on a stiffness beyond which a law is far from linear in the bends of a vibration."""


@dataclass(frozen=True)
class BendVibration:
    """The bends of an arm's vibration.

    Args:
        bends: By which it differs from the arm at rest under the same drive, shape (samples, segments, 2);
            zero where either is not known.
        rates: Their derivatives by time, shape (samples, segments, 2).
    """

    bends: Floats
    rates: Floats

    @classmethod
    def of(cls, clock: Floats, vibrating: Floats, still: Floats, known: Flags) -> "BendVibration":
        """Compare the strains of a vibrating arm with those at rest.

        Args:
            clock: Time of each sample [s], shape (samples,).
            vibrating: Strains, shape (samples, segments, 4).
            still: The same at rest.
            known: Samples at which both are known, shape (samples,).
        """
        bends = np.where(known[:, None, None], (vibrating - still)[..., :2], 0.0)
        # Of 3 Hz, sampled at 10 Hz, central differences give half the rate and a spline nine tenths.
        rates = CubicSpline(clock, bends)(clock, 1) if len(clock) > 1 else np.zeros_like(bends)
        return cls(bends, rates)


@dataclass(frozen=True)
class EquivalentSegment:
    """A segment with a linear material that vibrates nearly as one with another law does.

    Args:
        segment: Its number.
        stiffness_factor: On the bending stiffness of before.
        damping_time: Damping that is added, over the new stiffness [s].
    """

    segment: int
    stiffness_factor: float
    damping_time: float

    @property
    def bends(self) -> slice:
        """Where its bends are among the strains of all segments."""
        return slice(4 * self.segment, 4 * self.segment + 2)


def linearise(
    vibration: BendVibration, change: Floats, change_at_rest: Floats, segments: Flags, least_damping: float
) -> tuple[tuple[EquivalentSegment, ...], Floats]:
    """Fit a stiffness and a damping to what a law changes of the strains of a vibrating arm.

    A law turns the bends u of an arm into u + e(u). What a vibration x adds to e is g x + h x' by least
    squares over the recording (equivalent linearisation: T. K. Caughey, J. Acoust. Soc. Am. 35 (1963) 1706).
    Under a load q = K u such a segment strains by (1 + g) u + h u', to first order in h as one of the
    stiffness K / (1 + g) and the damping time -h / (1 + g).

    Args:
        vibration: How the arm vibrates without the law.
        change: What the law changes of the strains of the vibrating arm, shape (samples, segments, 4).
        change_at_rest: The same of the arm at rest.
        segments: Which segments the law changes, shape (segments,).
        least_damping: What is added to the damping over the stiffness at least [s], lest the arm gain energy.

    Returns:
        These segments, and what the law changes besides, of the shape of the change.
    """
    left, found = change.copy(), []
    for k in np.flatnonzero(segments):
        motion = np.stack([vibration.bends[:, k].ravel(), vibration.rates[:, k].ravel()])
        answer = np.nan_to_num(change[:, k, :2] - change_at_rest[:, k, :2]).ravel()
        slope, lag = (np.linalg.pinv(motion @ motion.T, hermitian=True) @ (motion @ answer)).tolist()
        stiffness = float(np.clip(1.0 / max(1.0 + slope, 1.0 / STIFFEST), SOFTEST, STIFFEST))
        damping = max(-lag * stiffness, least_damping / stiffness)
        slope, lag = 1.0 / stiffness - 1.0, -damping / stiffness
        left[:, k, :2] -= slope * vibration.bends[:, k] + lag * vibration.rates[:, k]
        found.append(EquivalentSegment(int(k), stiffness, damping))
    return tuple(found), left
