"""The library of manoeuvres: what separates the physical effects.

Each takes a generator of random numbers where it has a choice; pressures are gauge [Pa], times [s].
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from softarm.fakes.plant.manoeuvre import SAMPLE, CordPull, Grip, PlantManoeuvre, chain, samples

Floats = NDArray[np.float64]
Random = np.random.Generator

CHAMBERS = 6
HIGHEST = 50e3
STAGE_SPEED = 0.02


def rest(seconds: float = 20.0) -> PlantManoeuvre:
    """Leave the arm vented."""
    return PlantManoeuvre("rest", np.zeros((samples(seconds), CHAMBERS)))


def path(name: str, points: Floats, times: Floats) -> PlantManoeuvre:
    """Go through pressures, linear in between: points of shape (points, chambers) at rising times from 0."""
    clock = np.arange(samples(float(times[-1]))) * SAMPLE
    return PlantManoeuvre(name, np.column_stack([np.interp(clock, times, column) for column in points.T]))


def random_pressures(rng: Random, highest: float = HIGHEST) -> Floats:
    """Draw pressures as an allocation gives them: one or two chambers of each segment, the third vented."""
    pressures = rng.uniform(0.0, highest, CHAMBERS)
    for first in (0, 3):
        pressures[first + rng.integers(3)] = 0.0
    return pressures


def one_of_each(rng: Random) -> tuple[int, int]:
    """Draw a chamber of the upper and one of the lower segment."""
    return int(rng.integers(3)), 3 + int(rng.integers(3))


def random_holds(
    rng: Random, seconds: float = 60.0, hold: float = 5.0, ramp: float = 0.4, highest: float = HIGHEST
) -> PlantManoeuvre:
    """Go from one random pose to another and hold each."""
    count = max(1, round(seconds / hold))
    levels = np.array([random_pressures(rng, highest) for _ in range(count)])
    points, times = [np.zeros(CHAMBERS)], [0.0]
    for number, level in enumerate(levels):
        points += [level, level]
        times += [number * hold + ramp, (number + 1) * hold]
    return path("random_holds", np.array(points), np.array(times))


def ramps(
    rng: Random, durations: tuple[float, ...] = (4.0, 10.0, 30.0), highest: float = HIGHEST
) -> PlantManoeuvre:
    """Go to one random pose and back, at several rates."""
    level = random_pressures(rng, highest)
    points, times = [np.zeros(CHAMBERS)], [0.0]
    for duration in durations:
        points += [level, level, np.zeros(CHAMBERS), np.zeros(CHAMBERS)]
        times += [times[-1] + step for step in np.cumsum([duration, 2.0, duration, 2.0])]
    return path("ramps", np.array(points), np.array(times))


def triangles(
    chambers: tuple[int, ...] = (0, 4), rates: tuple[float, ...] = (5e3, 20e3), highest: float = HIGHEST
) -> PlantManoeuvre:
    """Cycle chambers between zero and two amplitudes at two rates [Pa/s], with reversal curves inside."""
    points, times = [np.zeros(CHAMBERS)], [0.0]
    mask = np.isin(np.arange(CHAMBERS), chambers).astype(float)
    for rate in rates:
        for level in (1.0, 0.3, 0.8, 0.0, 0.5, 0.0):
            points.append(level * highest * mask)
            times.append(times[-1] + float(np.abs(points[-1] - points[-2]).max()) / rate)
    return path("triangles", np.array(points), np.array(times))


def long_holds(rng: Random, hold: float = 40.0, count: int = 2, highest: float = HIGHEST) -> PlantManoeuvre:
    """Hold random poses for long, vented as long after each."""
    points, times = [np.zeros(CHAMBERS)], [0.0]
    for _ in range(count):
        level = random_pressures(rng, highest)
        points += [level, level, np.zeros(CHAMBERS), np.zeros(CHAMBERS)]
        times += [times[-1] + step for step in np.cumsum([0.4, hold, 0.4, hold])]
    return path("long_holds", np.array(points), np.array(times))


def growing_cycles(
    chambers: tuple[int, ...] = (0, 3), cycle: float = 8.0, levels: tuple[float, ...] = (0.25, 0.5, 0.75, 1.0)
) -> PlantManoeuvre:
    """Cycle a rested arm twice at each amplitude, growing; the first passage is seen once only."""
    mask = np.isin(np.arange(CHAMBERS), chambers).astype(float) * HIGHEST
    points, times = [np.zeros(CHAMBERS)], [0.0]
    for level in np.repeat(levels, 2):
        points += [level * mask, np.zeros(CHAMBERS)]
        times += [times[-1] + 0.5 * cycle, times[-1] + cycle]
    return path("growing_cycles", np.array(points), np.array(times))


def each_alone(ramp: float = 4.0, hold: float = 2.0, highest: float = HIGHEST) -> PlantManoeuvre:
    """Fill and vent each chamber alone."""
    points, times = [np.zeros(CHAMBERS)], [0.0]
    for chamber in range(CHAMBERS):
        full = np.eye(CHAMBERS)[chamber] * highest
        points += [full, full, np.zeros(CHAMBERS), np.zeros(CHAMBERS)]
        times += [times[-1] + step for step in np.cumsum([ramp, hold, ramp, hold])]
    return path("each_alone", np.array(points), np.array(times))


def co_contraction(ramp: float = 6.0, hold: float = 3.0, highest: float = 40e3) -> PlantManoeuvre:
    """Fill all chambers of a segment together, then of both; then bend on top of a common level."""
    upper, lower = np.repeat([1.0, 0.0], 3), np.repeat([0.0, 1.0], 3)
    bent = 0.5 * (upper + lower) + 0.5 * np.eye(CHAMBERS)[1] + 0.5 * np.eye(CHAMBERS)[5]
    points, times = [np.zeros(CHAMBERS)], [0.0]
    for level in (upper, lower, upper + lower, bent):
        points += [highest * level, highest * level, np.zeros(CHAMBERS), np.zeros(CHAMBERS)]
        times += [times[-1] + step for step in np.cumsum([ramp, hold, ramp, hold])]
    return path("co_contraction", np.array(points), np.array(times))


def steps(rng: Random, count: int = 6, hold: float = 4.0, highest: float = HIGHEST) -> PlantManoeuvre:
    """Jump to random poses and let go, so that the arm rings."""
    commands = []
    for _ in range(count):
        commands += [np.tile(random_pressures(rng, highest), (samples(hold), 1))]
        commands += [np.zeros((samples(hold), CHAMBERS))]
    return PlantManoeuvre("steps", np.concatenate(commands))


def staircase(rise: float = 1e3, hold: float = 1.5, top: float = 8e3) -> PlantManoeuvre:
    """Raise each chamber in small steps from zero: what a valve's dead band hides."""
    levels = np.arange(0.0, top + rise, rise)
    commands = [
        np.repeat(np.outer(levels, np.eye(CHAMBERS)[chamber]), samples(hold), axis=0)
        for chamber in range(CHAMBERS)
    ]
    return PlantManoeuvre("staircase", np.concatenate(commands))


def directions(count: int, rise: float = 0.0, turn: float = 0.0) -> tuple[tuple[float, float, float], ...]:
    """Spread directions round the arm, laboratory frame, ``rise`` upwards, the first at ``turn`` [rad]."""
    angles = turn + 2.0 * np.pi * np.arange(count) / count
    return tuple((float(np.cos(a)), float(np.sin(a)), rise) for a in angles)


def pulled_steps(
    section: str = "tip",
    count: int = 8,
    travel: float = 0.006,
    hold: float = 2.0,
    ways: tuple[tuple[float, float, float], ...] = directions(3),
    pressures: Floats | None = None,
) -> PlantManoeuvre:
    """Draw a section away in small steps of the gauge's stage, through slack, in several directions."""
    points = travel * np.repeat([*range(count), 0], 2)
    moves = np.abs(np.diff(points[::2])) / STAGE_SPEED
    times = np.cumsum(np.column_stack([np.concatenate([[0.0], moves]), np.full(count + 1, hold)]).ravel())
    stage = np.interp(np.arange(samples(float(times[-1]))) * SAMPLE, times, points)
    return _pulls("pulled_steps", section, stage, ways, pressures)


def pulled_small_steps(rng: Random, section: str = "tip", travel: float = 0.0065) -> PlantManoeuvre:
    """Draw a section away in a dozen small steps, in three random directions."""
    ways = directions(3, turn=float(rng.uniform(0.0, 2.0 * np.pi)))
    return pulled_steps(section, count=12, travel=travel, hold=1.5, ways=ways)


def pulled_ramps(
    section: str = "tip",
    reach: float = 0.05,
    seconds: float = 10.0,
    ways: tuple[tuple[float, float, float], ...] = directions(3),
    pressures: Floats | None = None,
) -> PlantManoeuvre:
    """Draw a section away and back evenly by the gauge's stage, in several directions."""
    there = np.linspace(0.0, reach, samples(seconds))
    return _pulls("pulled_ramps", section, np.concatenate([there, there[::-1]]), ways, pressures)


def _pulls(
    name: str,
    section: str,
    stage: Floats,
    ways: tuple[tuple[float, float, float], ...],
    pressures: Floats | None,
) -> PlantManoeuvre:
    """Repeat one travel of the stage in several directions, two seconds free between."""
    level = np.zeros(CHAMBERS) if pressures is None else np.asarray(pressures)
    lead, free = samples(4.0), samples(2.0)
    length = len(stage) + free
    pulls = tuple(
        CordPull(section, lead + number * length, direction, stage) for number, direction in enumerate(ways)
    )
    commands = np.tile(level, (lead + len(ways) * length, 1))
    commands[:lead] *= np.minimum(1.0, np.arange(lead) / samples(2.0))[:, None]
    return PlantManoeuvre(name, commands, pulls)


def against_the_cord(
    rng: Random, section: str = "tip", count: int = 3, seconds: float = 8.0, highest: float = HIGHEST
) -> PlantManoeuvre:
    """Ramp the pressures up and down while the cord holds the arm back on one side."""
    parts = []
    for direction in directions(count):
        level = random_pressures(rng, highest)
        there = np.linspace(0.0, 1.0, samples(seconds))
        ramp = np.concatenate([there, there[::-1], np.zeros(samples(2.0))])
        pull = CordPull(section, 0, direction, np.zeros(2 * samples(seconds)), slack=0.01)
        parts.append(PlantManoeuvre("", np.outer(ramp, level), (pull,)))
    return chain("against_the_cord", *parts)


def pulled_taut(
    rng: Random, section: str = "tip", seconds: float = 8.0, highest: float = 45e3
) -> PlantManoeuvre:
    """Ramp up and down the chambers that bend the arm away from the gauge, from each chamber's side in turn.

    A second chamber of each segment is filled a little, so that the arm also moves across the cord.
    """
    parts = []
    there = np.linspace(0.0, 1.0, samples(seconds))
    ramp = np.concatenate([there, there[::-1], np.zeros(samples(2.0))])
    for chamber in range(3):
        level = np.zeros(CHAMBERS)
        level[[chamber, 3 + chamber]] = highest * rng.uniform(0.8, 1.0, 2)
        beside = (chamber + 1 + rng.integers(2)) % 3
        level[[beside, 3 + beside]] = 0.35 * highest * rng.uniform(0.0, 1.0, 2)
        side = -2.0 * np.pi * chamber / 3.0  # the hanging mount turns the base frame about x
        direction = (float(np.cos(side)), float(np.sin(side)), 0.0)
        pull = CordPull(section, 0, direction, np.zeros(2 * samples(seconds)), slack=0.002)
        parts.append(PlantManoeuvre("", np.outer(ramp, level), (pull,)))
    return chain("pulled_taut", *parts)


def pulled_taut_steps(
    rng: Random, section: str = "tip", levels: int = 4, hold: float = 2.0, highest: float = 45e3
) -> PlantManoeuvre:
    """Fill the chambers that bend the arm away from the gauge in steps, each held, from each side in turn."""
    parts = []
    stairs = np.repeat(np.linspace(0.0, 1.0, levels + 1)[1:], samples(hold))
    ramp = np.concatenate([np.zeros(samples(1.0)), stairs, np.zeros(samples(3.0))])
    for chamber in range(3):
        level = np.zeros(CHAMBERS)
        level[[chamber, 3 + chamber]] = highest * rng.uniform(0.8, 1.0, 2)
        side = -2.0 * np.pi * chamber / 3.0  # the hanging mount turns the base frame about x
        direction = (float(np.cos(side)), float(np.sin(side)), 0.0)
        pull = CordPull(section, 0, direction, np.zeros(samples(1.0) + len(stairs)), slack=0.002)
        parts.append(PlantManoeuvre("", np.outer(ramp, level), (pull,)))
    return chain("pulled_taut_steps", *parts)


def taught(
    rng: Random,
    count: int = 5,
    reach: float = 0.06,
    hold: float = 4.0,
    section: str = "tip",
    drawn: tuple[float, float] = (-0.018, 0.018),
) -> PlantManoeuvre:
    """Lead a section by hand to random poses and hold each.

    Args:
        rng: Draws the poses.
        count: How many.
        reach: How far to the sides the hand goes [m].
        hold: How long it stays [s].
        section: What it holds.
        drawn: How far down it goes, least and most [m]: the hanging arm is drawn out.
    """
    move, stay = samples(1.5), samples(hold)
    low, high = np.array([-reach, -reach, -drawn[1]]), np.array([reach, reach, -drawn[0]])
    points = rng.uniform(low, high, (count, 3))
    way, last = [np.zeros((stay, 3))], np.zeros(3)
    for point in points:
        blend = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, move))[:, None]
        way += [last + blend * (point - last), np.tile(point, (stay, 1))]
        last = point
    trail = np.concatenate(way)
    grip = Grip(section, samples(1.0), trail)
    return PlantManoeuvre("taught", np.zeros((samples(2.0) + len(trail), CHAMBERS)), grips=(grip,))


LIBRARY: dict[str, Callable[[Random], PlantManoeuvre]] = {
    "rest": lambda rng: rest(),  # noqa: ARG005
    "random_holds": random_holds,
    "ramps": ramps,
    "triangles": lambda rng: triangles(),  # noqa: ARG005
    "long_holds": long_holds,
    "growing_cycles": lambda rng: growing_cycles(),  # noqa: ARG005
    "each_alone": lambda rng: each_alone(),  # noqa: ARG005
    "co_contraction": lambda rng: co_contraction(),  # noqa: ARG005
    "steps": steps,
    "staircase": lambda rng: staircase(),  # noqa: ARG005
    "pulled_steps": lambda rng: pulled_steps(),  # noqa: ARG005
    "pulled_ramps": lambda rng: pulled_ramps(),  # noqa: ARG005
    "pulled_small_steps": pulled_small_steps,
    "pulled_small_steps_intermediate": partial(pulled_small_steps, section="intermediate", travel=0.003),
    "pulled_steps_intermediate": lambda rng: pulled_steps("intermediate"),  # noqa: ARG005
    "against_the_cord": against_the_cord,
    "pulled_taut": pulled_taut,
    "pulled_taut_steps": pulled_taut_steps,
    "taught": taught,
    "taught_drawn": partial(taught, drawn=(0.015, 0.045)),
    "taught_intermediate": partial(taught, section="intermediate"),
}
