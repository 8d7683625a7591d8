"""Arms without pressures that are held, let go, and vibrate: they are judged once they have come to rest.

Before the release a hand holds the arm in a pose that gives no information on its weight; while the
vibration decays, means over a few periods are not yet the rest pose.
"""

from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.errors import InputError

RINGS = 8.0
"""Periods after which a vibration counts as decayed."""
UNDRIVEN = 1000.0
"""Pressures below it [Pa] drive nothing."""
STARTUP = 0.12
"""Seconds at the beginning of a recording that motion capture needs to start."""
DEPARTURE = 0.03
"""Share of the whole motion at which an arm counts as let go."""
LEAST_SAMPLES = 20
LEAST_HOLD = 0.1
"""Shortest time for which it is held [s]."""


@dataclass(frozen=True)
class Release:
    """A release that was found.

    Args:
        session: The session once the vibration has decayed.
        time: When it was let go [s].
    """

    session: Session
    time: float


def find_release(session: Session, natural_frequency: float | None) -> Release | None:
    """Find the release of an arm that no pressure drives.

    Args:
        session: At its own rate.
        natural_frequency: At which it vibrates [Hz].

    Returns:
        ``None`` where pressures drive it or it does not vibrate.

    Raises:
        InputError: The recording ends before the vibration has decayed. What it shows is the hand that held
            the arm.
    """
    if natural_frequency is None or float(session.pressures.max(initial=0.0)) > UNDRIVEN:
        return None
    time = session.clock - session.clock[0]
    column = _largest(session.readings[time > STARTUP])
    values = session.readings[:, column]
    start = float(np.nanmedian(values[(time > STARTUP) & (time < STARTUP + LEAST_HOLD)]))
    whole = float(np.nanmax(np.abs(values[time > STARTUP] - start)))
    moved = (np.abs(values - start) > DEPARTURE * whole) & (time > STARTUP)
    first = int(np.argmax(moved))
    if whole <= 0.0 or time[first] < STARTUP + LEAST_HOLD:
        return None
    released = float(session.time[first])
    settled = np.asarray(time >= time[first] + RINGS / natural_frequency)
    if settled.sum() < LEAST_SAMPLES:
        left = float(time[-1] - time[first])
        least = RINGS / natural_frequency + LEAST_SAMPLES * session.step
        raise InputError(
            session.name,
            f"the arm was let go at {released:.2f} s, and the recording ends {left:.2f} s later, before "
            f"its vibration of {natural_frequency:.1f} Hz has decayed",
            f"record at least {least:.1f} s after the release",
        )
    return Release(replace(session.thin(settled), natural_frequency=natural_frequency), released)


def _largest(readings: Floats) -> int:
    """Find the reading that moves most, shape (samples, readings)."""
    spread = np.nanmax(readings, axis=0) - np.nanmin(readings, axis=0)
    return int(np.nanargmax(spread))
