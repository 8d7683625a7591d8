"""The library of manoeuvres: what separates the physical effects.

Each takes a generator of random numbers where it has a choice; pressures are gauge [Pa], times [s].
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.fakes.plant.manoeuvre import SAMPLE, CordPull, Grip, PlantManoeuvre, chain, samples
from softarm.fakes.plant.state import STAGE_SPEED

Random = np.random.Generator


@dataclass(frozen=True)
class ChamberLayout:
    """The properties of an arm that a manoeuvre needs.

    Args:
        groups: Chambers of each segment.
        azimuths: Of the chambers [rad], shape (chambers,).
        highest: Pressure up to which it is driven [Pa].
        sections: That move, the last one at the tip.
    """

    groups: tuple[tuple[int, ...], ...] = ((0, 1, 2), (3, 4, 5))
    azimuths: tuple[float, ...] = (0.0, 2.0 * np.pi / 3.0, 4.0 * np.pi / 3.0) * 2
    highest: float = 50e3
    sections: tuple[str, ...] = ("intermediate", "tip")

    @property
    def chambers(self) -> int:
        """Number of chambers."""
        return len(self.azimuths)

    @property
    def vented(self) -> Floats:
        """No pressure in any chamber, shape (chambers,)."""
        return np.zeros(self.chambers)

    def only(self, *chambers: int) -> Floats:
        """Return 1 for some chambers and 0 for the others, shape (chambers,)."""
        return np.isin(np.arange(self.chambers), chambers).astype(float)


SOPRA = ChamberLayout()
JUMP = 0.4
"""Time in which pressures go to a pose that is held [s]."""


def rest(seconds: float = 20.0, on: ChamberLayout = SOPRA) -> PlantManoeuvre:
    """Leave the arm vented."""
    return PlantManoeuvre("rest", np.zeros((samples(seconds), on.chambers)))


def path(name: str, points: Floats, times: Floats) -> PlantManoeuvre:
    """Go through pressures, linear in between: points of shape (points, chambers) at rising times from 0."""
    clock = np.arange(samples(float(times[-1]))) * SAMPLE
    return PlantManoeuvre(name, np.column_stack([np.interp(clock, times, column) for column in points.T]))


def random_pressures(rng: Random, highest: float | None = None, on: ChamberLayout = SOPRA) -> Floats:
    """Draw pressures as an allocation gives them: one chamber of each segment stays vented."""
    pressures = rng.uniform(0.0, highest or on.highest, on.chambers)
    for group in on.groups:
        pressures[group[rng.integers(len(group))]] = 0.0
    return pressures


def one_of_each(rng: Random, on: ChamberLayout = SOPRA) -> tuple[int, ...]:
    """Draw a chamber of the first segment and, where there are more, one of the last."""
    groups = dict.fromkeys((on.groups[0], on.groups[-1]))
    return tuple(group[rng.integers(len(group))] for group in groups)


def random_holds(
    rng: Random, seconds: float = 60.0, hold: float = 5.0, on: ChamberLayout = SOPRA
) -> PlantManoeuvre:
    """Go from one random pose to another and hold each."""
    points, times = [on.vented], [0.0]
    for number in range(max(1, round(seconds / hold))):
        points += [random_pressures(rng, on=on)] * 2
        times += [number * hold + JUMP, (number + 1) * hold]
    return path("random_holds", np.array(points), np.array(times))


def ramps(
    rng: Random, durations: tuple[float, ...] = (4.0, 10.0, 30.0), on: ChamberLayout = SOPRA
) -> PlantManoeuvre:
    """Go to one random pose and back, at several rates."""
    level = random_pressures(rng, on=on)
    return _filled("ramps", [level] * len(durations), durations, 2.0, on)


def triangles(chambers: tuple[int, ...] = (), on: ChamberLayout = SOPRA) -> PlantManoeuvre:
    """Cycle chambers between zero and two amplitudes at two rates, with reversal curves inside."""
    chambers = chambers or (on.groups[0][0], on.groups[-1][1 % len(on.groups[-1])])
    points, times = [on.vented], [0.0]
    mask = on.only(*chambers)
    for rate in (5e3, 20e3):  # Pa/s
        for level in (1.0, 0.3, 0.8, 0.0, 0.5, 0.0):
            points.append(level * on.highest * mask)
            times.append(times[-1] + float(np.abs(points[-1] - points[-2]).max()) / rate)
    return path("triangles", np.array(points), np.array(times))


def long_holds(rng: Random, hold: float = 40.0, count: int = 2, on: ChamberLayout = SOPRA) -> PlantManoeuvre:
    """Hold random poses for long, vented as long after each."""
    levels = [random_pressures(rng, on=on) for _ in range(count)]
    return _filled("long_holds", levels, [JUMP] * count, hold, on)


def growing_cycles(
    chambers: tuple[int, ...] = (), cycle: float = 8.0, on: ChamberLayout = SOPRA
) -> PlantManoeuvre:
    """Cycle a rested arm twice at each amplitude, growing; the first passage is seen once only."""
    chambers = chambers or (on.groups[0][0], on.groups[-1][0])
    mask = on.only(*chambers) * on.highest
    points, times = [on.vented], [0.0]
    for level in np.repeat((0.25, 0.5, 0.75, 1.0), 2):
        points += [level * mask, on.vented]
        times += [times[-1] + 0.5 * cycle, times[-1] + cycle]
    return path("growing_cycles", np.array(points), np.array(times))


def each_alone(
    ramp: float = 4.0, hold: float = 2.0, highest: float | None = None, on: ChamberLayout = SOPRA
) -> PlantManoeuvre:
    """Fill and vent each chamber alone."""
    levels = [on.only(chamber) * (highest or on.highest) for chamber in range(on.chambers)]
    return _filled("each_alone", levels, [ramp] * len(levels), hold, on)


def co_contraction(
    ramp: float = 6.0, highest: float | None = None, on: ChamberLayout = SOPRA
) -> PlantManoeuvre:
    """Fill all chambers of a segment together, then of all; then bend on top of a common level."""
    highest = highest or 0.8 * on.highest
    each = [on.only(*group) for group in on.groups]
    together = np.ones(on.chambers)
    bent = 0.5 * together + 0.5 * on.only(on.groups[0][1 % len(on.groups[0])], on.groups[-1][-1])
    levels = [highest * level for level in (*each, together, bent)]
    return _filled("co_contraction", levels, [ramp] * len(levels), 3.0, on)


def _filled(
    name: str, levels: Sequence[Floats], ramps: Sequence[float], hold: float, on: ChamberLayout
) -> PlantManoeuvre:
    """Go to each level evenly, hold it, come back as fast, and stay vented as long."""
    points, times = [on.vented], [0.0]
    for level, ramp in zip(levels, ramps, strict=True):
        points += [level, level, on.vented, on.vented]
        times += [times[-1] + step for step in np.cumsum([ramp, hold, ramp, hold])]
    return path(name, np.array(points), np.array(times))


def steps(rng: Random, count: int = 6, on: ChamberLayout = SOPRA) -> PlantManoeuvre:
    """Jump to random poses and let go, so that the arm rings."""
    commands = []
    for _ in range(count):
        commands += [np.tile(random_pressures(rng, on=on), (samples(4.0), 1))]
        commands += [np.zeros((samples(4.0), on.chambers))]
    return PlantManoeuvre("steps", np.concatenate(commands))


def staircase(
    rise: float = 1e3, hold: float = 1.5, top: float = 8e3, on: ChamberLayout = SOPRA
) -> PlantManoeuvre:
    """Raise each chamber in small steps from zero: what a valve's dead band hides."""
    levels = np.arange(0.0, top + rise, rise)
    commands = [
        np.repeat(np.outer(levels, on.only(chamber)), samples(hold), axis=0) for chamber in range(on.chambers)
    ]
    return PlantManoeuvre("staircase", np.concatenate(commands))


def directions(count: int, first: float = 0.0) -> tuple[tuple[float, float, float], ...]:
    """Spread horizontal directions round the arm, laboratory frame, the first at an angle [rad]."""
    angles = first + 2.0 * np.pi * np.arange(count) / count
    return tuple((float(np.cos(a)), float(np.sin(a)), 0.0) for a in angles)


def pulled_steps(
    section: str | None = None,
    count: int = 8,
    travel: float = 0.006,
    hold: float = 2.0,
    ways: tuple[tuple[float, float, float], ...] = directions(3),
    pressures: Floats | None = None,
    on: ChamberLayout = SOPRA,
) -> PlantManoeuvre:
    """Draw a section away in small steps of the gauge's stage, through slack, in several directions."""
    points = travel * np.repeat([*range(count), 0], 2)
    moves = np.abs(np.diff(points[::2])) / STAGE_SPEED
    times = np.cumsum(np.column_stack([np.concatenate([[0.0], moves]), np.full(count + 1, hold)]).ravel())
    stage = np.interp(np.arange(samples(float(times[-1]))) * SAMPLE, times, points)
    return _pulls("pulled_steps", section or on.sections[-1], stage, ways, pressures, on)


def pulled_small_steps(
    rng: Random, section: str | None = None, travel: float = 0.0065, on: ChamberLayout = SOPRA
) -> PlantManoeuvre:
    """Draw a section away in a dozen small steps, in three random directions."""
    ways = directions(3, float(rng.uniform(0.0, 2.0 * np.pi)))
    return pulled_steps(section, count=12, travel=travel, hold=1.5, ways=ways, on=on)


def pulled_ramps(on: ChamberLayout = SOPRA) -> PlantManoeuvre:
    """Draw the tip 50 mm away and back evenly by the gauge's stage, in several directions."""
    there = np.linspace(0.0, 0.05, samples(10.0))
    return _pulls(
        "pulled_ramps", on.sections[-1], np.concatenate([there, there[::-1]]), directions(3), None, on
    )


def plucked(on: ChamberLayout = SOPRA) -> PlantManoeuvre:
    """Draw the tip 40 mm away as fast as the gauge's stage moves, and let go, so that the arm swings."""
    away = np.linspace(0.0, 0.04, samples(0.04 / STAGE_SPEED))
    stage = np.concatenate([away, np.full(samples(1.0), 0.04)])
    return _pulls("plucked", on.sections[-1], stage, directions(3), None, on, slack=3.0)


def _pulls(
    name: str,
    section: str,
    stage: Floats,
    ways: tuple[tuple[float, float, float], ...],
    pressures: Floats | None,
    on: ChamberLayout,
    slack: float = 2.0,
) -> PlantManoeuvre:
    """Repeat one travel of the stage in several directions, some seconds free after each."""
    level = on.vented if pressures is None else np.asarray(pressures)
    lead = samples(4.0)
    length = len(stage) + samples(slack)
    pulls = tuple(
        CordPull(section, lead + number * length, direction, stage) for number, direction in enumerate(ways)
    )
    commands = np.tile(level, (lead + len(ways) * length, 1))
    commands[:lead] *= np.minimum(1.0, np.arange(lead) / samples(2.0))[:, None]
    return PlantManoeuvre(name, commands, pulls)


def against_the_cord(rng: Random, on: ChamberLayout = SOPRA) -> PlantManoeuvre:
    """Ramp the pressures up and down while the cord holds the tip back on one side."""
    parts = []
    for direction in directions(3):
        level = random_pressures(rng, on=on)
        ramp = _up_and_down()
        pull = CordPull(on.sections[-1], 0, direction, np.zeros(2 * samples(8.0)), slack=0.01)
        parts.append(PlantManoeuvre("", np.outer(ramp, level), (pull,)))
    return chain("against_the_cord", *parts)


def _up_and_down() -> Floats:
    """Return a ramp from 0 to 1 in 8 s and back, and 2 s at zero."""
    there = np.linspace(0.0, 1.0, samples(8.0))
    return np.concatenate([there, there[::-1], np.zeros(samples(2.0))])


def pulled_taut(rng: Random, on: ChamberLayout = SOPRA) -> PlantManoeuvre:
    """Ramp up and down the chambers that bend the arm away from the gauge, from each chamber's side in turn.

    A second chamber of each segment is filled a little, so that the arm also moves across the cord.
    """
    return _away("pulled_taut", rng, _up_and_down(), 2 * samples(8.0), 0.35, on)


def pulled_taut_steps(rng: Random, on: ChamberLayout = SOPRA) -> PlantManoeuvre:
    """Fill the chambers that bend the arm away from the gauge in steps, each held, from each side in turn."""
    stairs = np.repeat(np.linspace(0.0, 1.0, 5)[1:], samples(2.0))
    ramp = np.concatenate([np.zeros(samples(1.0)), stairs, np.zeros(samples(3.0))])
    return _away("pulled_taut_steps", rng, ramp, samples(1.0) + len(stairs), 0.0, on)


def _away(
    name: str, rng: Random, ramp: Floats, tied: int, across: float, on: ChamberLayout
) -> PlantManoeuvre:
    """Pull away from the gauge from each chamber's side in turn, with a cord that is tied for some samples.

    Chambers beside those in line are filled by up to a share ``across``.
    """
    parts, highest = [], 0.9 * on.highest
    for place, chamber in enumerate(on.groups[0]):
        level = on.vented
        level[_in_line(on, place)] = highest * rng.uniform(0.8, 1.0, len(on.groups))
        if across:
            beside = place + 1 + int(rng.integers(2))
            level[_in_line(on, beside)] = across * highest * rng.uniform(0.0, 1.0, len(on.groups))
        side = -on.azimuths[chamber]  # the hanging mount rotates the base frame about x
        direction = (float(np.cos(side)), float(np.sin(side)), 0.0)
        pull = CordPull(on.sections[-1], 0, direction, np.zeros(tied), slack=0.002)
        parts.append(PlantManoeuvre("", np.outer(ramp, level), (pull,)))
    return chain(name, *parts)


def _in_line(on: ChamberLayout, place: int) -> list[int]:
    """Return the chamber at a place, counted around the axis, of each segment."""
    return [group[place % len(group)] for group in on.groups]


def taught(
    rng: Random,
    count: int = 5,
    hold: float = 4.0,
    section: str | None = None,
    drawn: tuple[float, float] = (-0.018, 0.018),
    on: ChamberLayout = SOPRA,
) -> PlantManoeuvre:
    """Lead a section by hand to random poses, 60 mm to the sides at most, and hold each.

    Args:
        rng: Draws the poses.
        count: How many.
        hold: How long it stays [s].
        section: What it holds.
        drawn: How far down it goes, least and most [m]: the hanging arm is drawn out.
        on: The arm.
    """
    move, stay = samples(1.5), samples(hold)
    points = rng.uniform((-0.06, -0.06, -drawn[1]), (0.06, 0.06, -drawn[0]), (count, 3))
    way, last = [np.zeros((stay, 3))], np.zeros(3)
    for point in points:
        blend = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, move))[:, None]
        way += [last + blend * (point - last), np.tile(point, (stay, 1))]
        last = point
    trail = np.concatenate(way)
    grip = Grip(section or on.sections[-1], samples(1.0), trail)
    return PlantManoeuvre("taught", np.zeros((samples(2.0) + len(trail), on.chambers)), grips=(grip,))


def _first(on: ChamberLayout) -> str:
    """Return the first section below the base.

    Raises:
        InputError: It is the tip.
    """
    if len(on.sections) < 2:
        raise InputError("manoeuvre", "the arm has no section between base and tip", "choose another one")
    return on.sections[0]


LIBRARY: dict[str, Callable[[Random, ChamberLayout], PlantManoeuvre]] = {
    "rest": lambda _, on: rest(on=on),
    "random_holds": lambda rng, on: random_holds(rng, on=on),
    "ramps": lambda rng, on: ramps(rng, on=on),
    "triangles": lambda _, on: triangles(on=on),
    "long_holds": lambda rng, on: long_holds(rng, on=on),
    "growing_cycles": lambda _, on: growing_cycles(on=on),
    "each_alone": lambda _, on: each_alone(on=on),
    "co_contraction": lambda _, on: co_contraction(on=on),
    "steps": lambda rng, on: steps(rng, on=on),
    "staircase": lambda _, on: staircase(on=on),
    "pulled_steps": lambda _, on: pulled_steps(on=on),
    "pulled_ramps": lambda _, on: pulled_ramps(on=on),
    "plucked": lambda _, on: plucked(on=on),
    "pulled_small_steps": lambda rng, on: pulled_small_steps(rng, on=on),
    "pulled_small_steps_intermediate": lambda rng, on: pulled_small_steps(rng, _first(on), 0.003, on),
    "pulled_steps_intermediate": lambda _, on: pulled_steps(_first(on), on=on),
    "against_the_cord": lambda rng, on: against_the_cord(rng, on=on),
    "pulled_taut": lambda rng, on: pulled_taut(rng, on=on),
    "pulled_taut_steps": lambda rng, on: pulled_taut_steps(rng, on=on),
    "taught": lambda rng, on: taught(rng, on=on),
    "taught_drawn": lambda rng, on: taught(rng, drawn=(0.015, 0.045), on=on),
    "taught_intermediate": lambda rng, on: taught(rng, section=_first(on), on=on),
}
