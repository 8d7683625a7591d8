"""Length of a circular arc over its chord."""

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats

STRAIGHT = 1e-3  # rad, below which the leading terms are exact to rounding


@njit(cache=True, nogil=True)
def arc_kernel(angle: float) -> tuple[float, float]:
    """Compute f = (b / 2) / sin(b / 2) of an arc that bends by an angle b [rad], and f'(b) / b."""
    if angle < STRAIGHT:
        return 1.0 + angle * angle / 24.0, 1.0 / 12.0
    half = 0.5 * angle
    sine, cosine = np.sin(half), np.cos(half)
    return half / sine, 0.5 * (sine - half * cosine) / (sine * sine) / angle


def arc_over_chord(angle: Floats) -> tuple[Floats, Floats]:
    """Compute what ``arc_kernel`` does for each of many angles [rad]."""
    # Contiguous memory, so that the kernel is compiled for one type only.
    angles = np.array(angle, dtype=np.float64, order="C")
    ratios, slopes = np.empty_like(angles), np.empty_like(angles)
    _arcs(angles.reshape(-1), ratios.reshape(-1), slopes.reshape(-1))
    return ratios, slopes


@njit(cache=True, nogil=True)
def _arcs(angles: Floats, ratios: Floats, slopes: Floats) -> None:
    for n in range(len(angles)):
        ratios[n], slopes[n] = arc_kernel(angles[n])
