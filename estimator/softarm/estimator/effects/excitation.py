"""What a recording excites, so that an effect it cannot show is called not testable rather than absent."""

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.effects.effect import Excitation
from softarm.estimator.series import runs

QUIET = 300.0
"""Pressures that vary by less count as still [Pa]."""
OPEN = 1000.0
"""A chamber above it counts as driven [Pa]."""
SMALL = 5000.0
"""Largest of the small pressures [Pa]."""
HOLD = 10.0
REST = 20.0
LONG = 600.0
"""Shortest hold, rest and long run [s]."""
STEP_TIME = 0.5
"""A change of ``STEP`` within it is a step [s]."""
STEP = 3000.0
RATIO = 2.0
"""Rates, or amplitudes, this far apart count as two."""
LEAST_ROTATION = 0.5
"""A rotation of gravity by more counts as another mount [rad]."""


def inventory(time: Floats, pressures: Floats, gravity: Floats, limits: Floats) -> frozenset[Excitation]:
    """List what a recording excites.

    Args:
        time: Seconds, shape (samples,).
        pressures: Gauge pressures [Pa], shape (samples, chambers).
        gravity: Gravitational acceleration in the base frame, shape (samples, 3).
        limits: Largest gauge pressure of each chamber [Pa], shape (chambers,).
    """
    excitations: set[Excitation] = set()
    peaks = [_peaks(pressures[:, c]) for c in range(pressures.shape[1])]
    driven = pressures > OPEN
    alone = driven & (driven.sum(axis=1) == 1)[:, None]
    tests: dict[Excitation, bool] = {
        "motion": bool((np.ptp(pressures, axis=0) > OPEN).any()),
        "rest": _longest(time, pressures.max(axis=1) <= OPEN) >= REST,
        "holds": _longest_hold(time, pressures) >= HOLD,
        "pressure_steps": _has_steps(time, pressures),
        "two_rates": _spread(_rates(time, pressures)) >= RATIO,
        "two_amplitudes": any(_spread(p) >= RATIO for p in peaks),
        "growing_cycles": any(len(p) >= 2 and bool((np.diff(p) > QUIET).any()) for p in peaks),
        "large_pressures": bool((pressures.max(axis=0) > 0.6 * limits).any()),
        "small_pressures": bool(((pressures > QUIET) & (pressures < SMALL)).any()),
        "each_chamber": bool(alone.any(axis=0).all()),
        "mount_turned": mount_turned(gravity),
        "long_run": bool(time[-1] - time[0] >= LONG),
    }
    excitations.update(name for name, there in tests.items() if there)
    return frozenset(excitations)


def _longest(time: Floats, kept: Flags) -> float:
    """Return the longest stretch over which a flag holds [s]."""
    return float(max((time[end - 1] - time[start] for start, end in runs(kept)), default=0.0))


def _longest_hold(time: Floats, pressures: Floats) -> float:
    """Return the longest time for which driven pressures stay where they were when it began [s]."""
    longest, start = 0.0, 0
    for k in range(1, len(time)):
        if np.abs(pressures[k] - pressures[start]).max() > QUIET:
            start = k
        elif pressures[start].max() > OPEN:
            longest = max(longest, float(time[k] - time[start]))
    return longest


def _has_steps(time: Floats, pressures: Floats) -> bool:
    later = np.minimum(np.searchsorted(time, time + STEP_TIME, side="right") - 1, len(time) - 1)
    return bool(np.abs(pressures[later] - pressures).max() > STEP)


def _rates(time: Floats, pressures: Floats) -> Floats:
    """Return how fast pressures change where they do [Pa/s]."""
    change = np.abs(np.diff(pressures, axis=0)) / np.diff(time)[:, None]
    moving: Floats = change[change > QUIET]
    return moving


def _spread(values: Floats) -> float:
    """Return the ratio of the 90th to the 10th percentile, 0 without values."""
    if len(values) < 2:
        return 0.0
    low, high = np.percentile(values, [10.0, 90.0])
    return float(high / low)


def _peaks(pressure: Floats) -> Floats:
    """Return the tops of the excursions from the vented state [Pa]."""
    return np.array([pressure[start:end].max() for start, end in runs(pressure > OPEN)])


def mount_turned(gravity: Floats) -> bool:
    """Return whether gravity, shape (samples, 3), ever points ``LEAST_ROTATION`` away from its start."""
    sizes = np.linalg.norm(gravity, axis=1)
    cosine = (gravity @ gravity[0]) / np.maximum(sizes * sizes[0], 1e-12)
    return bool(np.arccos(np.clip(cosine, -1.0, 1.0)).max() > LEAST_ROTATION) if sizes[0] > 0.0 else False
