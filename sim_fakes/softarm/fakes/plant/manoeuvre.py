"""A manoeuvre: what is commanded, pulled and held over a stretch of time."""

from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Floats

SAMPLE = 0.01


@dataclass(frozen=True)
class CordPull:
    """The gauge on its stage draws a section by the cord.

    When the pull begins, the stage stands where the cord is ``slack`` short of taut in the direction given;
    from there it travels along that direction.

    Args:
        section: Rigid section the cord is tied to.
        start: Sample at which it is tied.
        direction: From the knot to the gauge, laboratory frame, shape (3,).
        travel: Of the stage from its start, one entry per sample [m].
        slack: Free length at the start [m].
        length: Of the cord [m].
    """

    section: str
    start: int
    direction: tuple[float, float, float]
    travel: Floats
    slack: float = 0.005
    length: float = 0.2

    @property
    def samples(self) -> int:
        """How long it lasts."""
        return len(self.travel)


@dataclass(frozen=True)
class Grip:
    """A hand holds a section and leads it.

    Args:
        section: Rigid section it holds.
        start: Sample at which it takes hold.
        path: Displacement of the hand from where it took hold, laboratory frame, shape (samples, 3) [m].
        stiffness: Of the grip [N/m].
    """

    section: str
    start: int
    path: Floats
    stiffness: float = 150.0

    @property
    def samples(self) -> int:
        """How long it lasts."""
        return len(self.path)


@dataclass(frozen=True)
class PlantManoeuvre:
    """Commands at 100 Hz, and pulls and grips on top.

    Args:
        name: What reports call it.
        commands: Commanded gauge pressures [Pa], shape (samples, chambers).
        pulls: Of the gauge, one after another.
        grips: Of the hand, one after another.
    """

    name: str
    commands: Floats
    pulls: tuple[CordPull, ...] = ()
    grips: tuple[Grip, ...] = ()

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return len(self.commands) * SAMPLE


def samples(seconds: float) -> int:
    """Count the samples of a stretch of time."""
    return max(1, round(seconds / SAMPLE))


def chain(name: str, *parts: PlantManoeuvre) -> PlantManoeuvre:
    """Run manoeuvres one after another."""
    starts = np.cumsum([0, *(len(part.commands) for part in parts)])
    moved = list(zip(starts, parts, strict=False))
    return PlantManoeuvre(
        name,
        np.concatenate([part.commands for part in parts]),
        tuple(replace(pull, start=pull.start + int(at)) for at, part in moved for pull in part.pulls),
        tuple(replace(grip, start=grip.start + int(at)) for at, part in moved for grip in part.grips),
    )
