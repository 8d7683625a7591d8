"""Length of a circular arc over its chord."""

import numpy as np

from softarm.estimator.arrays import Floats

STRAIGHT = 1e-3  # rad, below which the leading terms are exact to rounding


def arc_over_chord(angle: Floats) -> tuple[Floats, Floats]:
    """Compute f = (b / 2) / sin(b / 2) of an arc that bends by an angle b [rad], and f'(b) / b."""
    half = 0.5 * np.maximum(angle, STRAIGHT)
    sine, cosine = np.sin(half), np.cos(half)
    ratio = half / sine
    slope = 0.5 * (sine - half * cosine) / sine**2 / (2.0 * half)
    straight = angle < STRAIGHT
    return (
        np.where(straight, 1.0 + angle**2 / 24.0, ratio),
        np.where(straight, 1.0 / 12.0, slope),
    )
