"""Stretches that no steady law explains, put into numbers: when, in which streams, how large, like what."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Flags, Floats
from softarm.estimator.intake.result import Disturbance
from softarm.estimator.intake.unsteady import GUARD, LARGE, PROBABLE, HeldOutErrors, least_sizes, stretches
from softarm.estimator.specimen import Specimen
from softarm.estimator.specimen.body import Section

HALF = 0.06
"""Half the length of a segment [m]: about its middle a bend rotates what is below."""
ALIKE = 0.8
"""Share of an event's size that a pressure must explain to be called equivalent."""


@dataclass(frozen=True)
class Watched:
    """What the values are of which a law has left errors.

    Args:
        recording: Name of the recording.
        ends: Its first and last time [s].
        streams: Names of the streams, by their numbers.
        ranges: Range of the motion behind each value, shape (values,).
        levers: How far an angle moves the tip along x and y [m/rad], shape (values, 2).
        chambers: Numbers of the recorded chambers.
        slopes: What each pressure moves of each value [rad/Pa, m/Pa], shape (values, chambers).
    """

    recording: str
    ends: tuple[float, float]
    streams: tuple[str, ...]
    ranges: Floats
    levers: Floats
    chambers: tuple[int, ...]
    slopes: Floats


def disturbances(fit: HeldOutErrors, chances: Floats, watched: Watched) -> tuple[Disturbance, ...]:
    """Describe every stretch in which an event is probable and large enough to move a fit.

    Args:
        fit: What the law leaves.
        chances: Of an event in each second of each stream, shape (streams, seconds).
        watched: What the values are.
    """
    found = (_disturbance(fit, chances, watched, *ends) for ends in stretches(chances.max(axis=0)))
    return tuple(one for one in found if one is not None)


def tip_lever(specimen: Specimen, section: Section) -> float:
    """Return how far the bend of the segment above a section moves the tip [m/rad]."""
    return max(specimen.length_m - section.from_m + HALF, 0.0)


def _disturbance(
    fit: HeldOutErrors, chances: Floats, watched: Watched, begin: int, end: int
) -> Disturbance | None:
    """Describe a stretch; ``None`` where it is too small to move a fit."""
    during = (fit.seconds >= begin) & (fit.seconds < end)
    grid, usual = fit.grid, fit.usual
    sizes = np.percentile(np.abs(fit.errors[during]), LARGE, axis=0)
    enough = sizes > least_sizes(grid.units, watched.ranges)
    probable = np.isin(grid.stream, fit.numbers[chances[:, begin:end].max(axis=1) > PROBABLE])
    if not (enough & probable).any():
        return None
    angle, length = (np.array([unit == kind for unit in grid.units]) for kind in ("rad", "m"))
    moved = np.linalg.norm(fit.errors[during] @ watched.levers, axis=1)
    displacement = sizes[length].max() if length.any() else np.percentile(moved, LARGE)
    start, (first, last) = grid.time[0] - grid.step / 2, watched.ends
    return Disturbance(
        watched.recording,
        (max(start + begin - GUARD, first), min(start + end + GUARD, last)),
        tuple(dict.fromkeys(watched.streams[k] for k in grid.stream[enough & probable])),
        float(sizes[angle].max(initial=0.0)),
        float(displacement),
        float(usual[angle].max(initial=0.0)),
        float(usual[length].max(initial=0.0)),
        float(chances[:, begin:end].max()),
        _equivalent(fit, watched, during),
    )


def _equivalent(fit: HeldOutErrors, watched: Watched, during: Flags) -> tuple[int, float] | None:
    """Find the chamber whose pressure would do the same, by the linear part of the law."""
    slopes = (watched.slopes / fit.spreads[:, None]).T
    moved = np.median(fit.errors[during] / fit.spreads, axis=0)
    powers = (slopes**2).sum(axis=1)
    wanted = np.where(powers > 0, slopes @ moved / np.where(powers > 0, powers, 1.0), 0.0)
    remains = ((moved - wanted[:, None] * slopes) ** 2).sum(axis=1)
    remains[np.abs(wanted) > np.abs(fit.grid.pressures).max(initial=0.0)] = np.inf
    best = int(np.argmin(remains))
    if remains[best] > (1.0 - ALIKE) * float(moved @ moved):
        return None
    return watched.chambers[best], float(wanted[best])
