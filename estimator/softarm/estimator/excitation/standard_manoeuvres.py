"""Manoeuvres that separate the physical effects, for any lay-out of chambers."""

from collections.abc import Callable

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.excitation.manoeuvre import Manoeuvre, ManoeuvreLimits, ManoeuvrePath

Segments = tuple[int, ...]
"""Segment of each chamber."""

QUARTER = np.pi / 2.0
PLUCK = 0.3  # N, enough to make the arm vibrate and little enough to hold with two fingers
POSES = 10
# Multiples of the golden section modulo 1 never cluster.
GOLDEN = 0.6180339887


def standard_manoeuvres(segments: Segments, limits: ManoeuvreLimits) -> tuple[Manoeuvre, ...]:
    """List every manoeuvre in the order in which a whole run does them; the rested arm comes first."""
    makers = _MAKERS if segments else _WITHOUT_CHAMBERS
    return tuple(make(segments, limits) for make in makers)


def rest(segments: Segments, limits: ManoeuvreLimits) -> Manoeuvre:  # noqa: ARG001
    """Leave the arm vented: noise, its correlation in time, drift."""
    return ManoeuvrePath(limits).hold(60.0).manoeuvre("rest", "noise and drift")


def growing_cycles(segments: Segments, limits: ManoeuvreLimits) -> Manoeuvre:
    """Cycle one chamber of each segment twice at each amplitude; the first passage occurs only once."""
    path, full = ManoeuvrePath(limits), _one_of_each(segments, limits, 0)
    for level in np.repeat([0.25, 0.5, 0.75, 1.0], 2):
        path.go(level * full, 3.5).vent(3.5)
    return path.manoeuvre("growing_cycles", "softening on first stretch")


def each_alone(segments: Segments, limits: ManoeuvreLimits) -> Manoeuvre:  # noqa: ARG001
    """Fill and vent each chamber alone, slowly, then fast."""
    path = ManoeuvrePath(limits)
    for ramp, hold in ((4.0, 2.0), (0.4, 2.0)):
        for level in np.diag(limits.top):
            path.go(level, ramp).hold(hold).vent(ramp).hold(1.0)
    shows = "gain, bias, line and cross-talk of each chamber"
    return path.manoeuvre("each_alone", shows)


def ramps(segments: Segments, limits: ManoeuvreLimits) -> Manoeuvre:
    """Go to one pose and back at rates a decade apart."""
    path, full = ManoeuvrePath(limits), _one_of_each(segments, limits, 1)
    for seconds in (3.0, 10.0, 30.0):
        path.go(full, seconds).hold(2.0).vent(seconds).hold(2.0)
    return path.manoeuvre("ramps", "dependence on the rate")


def triangles(segments: Segments, limits: ManoeuvreLimits) -> Manoeuvre:
    """Make reversal curves at two amplitudes and two rates."""
    path, full = ManoeuvrePath(limits), _one_of_each(segments, limits, 0)
    for speed in (8e3, 40e3):
        for level, before in ((1.0, 0.0), (0.3, 1.0), (0.8, 0.3), (0.0, 0.8), (0.5, 0.0), (0.0, 0.5)):
            path.go(level * full, float(abs(level - before) * full.max()) / speed)
    return path.manoeuvre("triangles", "rate-independent hysteresis")


def holds(segments: Segments, limits: ManoeuvreLimits) -> Manoeuvre:
    """Step to a pose and hold it long, then vent and wait as long."""
    path = ManoeuvrePath(limits)
    path.go(_one_of_each(segments, limits, 2)).hold(40.0).vent().hold(40.0)
    return path.manoeuvre("holds", "creep and recovery")


def steps(segments: Segments, limits: ManoeuvreLimits) -> Manoeuvre:
    """Jump to poses and let go, so that the arm vibrates."""
    path = ManoeuvrePath(limits)
    for number in range(6):
        size = 1.0 if number % 2 else 0.4
        path.go(size * _one_of_each(segments, limits, number)).hold(3.0).vent().hold(3.0)
    return path.manoeuvre("steps", "lags, inertia and damping")


def staircase(segments: Segments, limits: ManoeuvreLimits) -> Manoeuvre:
    """Raise each chamber in small steps from zero: what a valve's dead band hides."""
    path = ManoeuvrePath(limits)
    for unit in np.eye(len(segments)):
        for level in np.arange(1e3, 8.5e3, 1e3):
            path.go(level * unit).hold(1.0)
        path.vent().hold(0.5)
    return path.manoeuvre("staircase", "dead bands and biases near zero")


def co_contraction(segments: Segments, limits: ManoeuvreLimits) -> Manoeuvre:
    """Fill all chambers of a segment together, then of all segments."""
    path, level = ManoeuvrePath(limits), 0.9 * limits.top
    groups = [np.array(segments) == s for s in sorted(set(segments))]
    for mask in (*groups, np.ones(len(segments), dtype=bool)):
        path.go(level * mask, 5.0).hold(2.0).vent(5.0).hold(1.0)
    return path.manoeuvre("co_contraction", "stretch without bending")


def poses(segments: Segments, limits: ManoeuvreLimits) -> Manoeuvre:
    """Go through mixed poses and hold each for some seconds."""
    path, count = ManoeuvrePath(limits), len(segments)
    for number in range(POSES):
        level = ((number + 1) * GOLDEN * np.arange(1, count + 1)) % 1.0 * limits.top
        for s in set(segments):
            mine = np.flatnonzero(np.array(segments) == s)
            if len(mine) > 1:
                level[mine[(number + s) % len(mine)]] = 0.0
        path.go(level, 0.5).hold(5.0)
    path.vent(0.5).hold(2.0)
    return path.manoeuvre("poses", "loads, contacts and other effects that depend on the pose")


def mount_turned(axis: str) -> Callable[[Segments, ManoeuvreLimits], Manoeuvre]:
    """Make the manoeuvre of each chamber alone with the mount rotated about an axis of the base."""

    def make(segments: Segments, limits: ManoeuvreLimits) -> Manoeuvre:  # noqa: ARG001
        path = ManoeuvrePath(limits).hold(5.0)
        for level in np.diag(limits.top):
            path.go(level, 1.5).hold(2.0).vent(1.5).hold(1.0)
        return path.manoeuvre(
            f"mount_turned_{axis}",
            "weight and sensors",
            f"turn the mount by 90 degrees about the {axis} axis of its base and clamp it there",
            (QUARTER, 0.0, 0.0) if axis == "x" else (0.0, QUARTER, 0.0),
        )

    return make


def pluck(segments: Segments, limits: ManoeuvreLimits) -> Manoeuvre:  # noqa: ARG001
    """Motion that no pressure causes: somebody draws the tip aside and lets go."""
    times, forces = [0.0], [np.zeros(3)]
    for direction in (np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])):
        for seconds, size in ((3.0, 0.0), (2.0, 1.0), (2.0, 1.0), (0.05, 0.0), (5.0, 0.0)):
            times.append(times[-1] + seconds)
            forces.append(PLUCK * size * direction)
    return Manoeuvre(
        "pluck",
        "inertia and damping without any pressure",
        np.array(times),
        np.zeros((len(times), len(limits.pressures))),
        "draw the tip aside, hold it for two seconds and let go; once along x, once along y",
        forces=np.array(forces),
    )


def _one_of_each(segments: Segments, limits: ManoeuvreLimits, number: int) -> Floats:
    """Choose one chamber of each segment, another one for each number; pressures of shape (chambers,)."""
    level = np.zeros(len(segments))
    for s in set(segments):
        mine = np.flatnonzero(np.array(segments) == s)
        chosen = mine[(number + s) % len(mine)]
        level[chosen] = limits.top[chosen]
    return level


_MAKERS: tuple[Callable[[Segments, ManoeuvreLimits], Manoeuvre], ...] = (
    growing_cycles,
    rest,
    each_alone,
    ramps,
    holds,
    triangles,
    steps,
    staircase,
    co_contraction,
    poses,
    mount_turned("x"),
    mount_turned("y"),
    pluck,
)
_WITHOUT_CHAMBERS = (rest, mount_turned("x"), mount_turned("y"), pluck)
