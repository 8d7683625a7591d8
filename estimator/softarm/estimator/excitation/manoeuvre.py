"""A manoeuvre: pressures over time that show some physics and hide the rest."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats


@dataclass(frozen=True)
class ManoeuvreLimits:
    """What no manoeuvre exceeds.

    Args:
        pressures: Largest gauge pressure of each chamber [Pa], shape (chambers,).
        slew: Fastest change of a set-point [Pa/s].
        share: Part of the largest pressures that manoeuvres use.
    """

    pressures: Floats
    slew: float = 200e3
    share: float = 0.75

    @property
    def top(self) -> Floats:
        """Largest pressures of manoeuvres [Pa], shape (chambers,)."""
        return self.share * self.pressures


@dataclass(frozen=True)
class Manoeuvre:
    """A path through pressures, linear between its points, from vented to vented.

    Args:
        name: What plans and recordings call it.
        shows: What it excites, in words for people.
        times: Of the points [s], rising from 0, shape (points,).
        pressures: At the points [Pa], shape (points, chambers).
        by_hand: What somebody does to the arm; empty where nobody is needed.
        rotation: Rotation vector of the mount in its usual base frame [rad].
        forces: Force on the last section at the points, by hand, base frame [N], shape (points, 3).
    """

    name: str
    shows: str
    times: Floats
    pressures: Floats
    by_hand: str = ""
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    forces: Floats | None = None

    @property
    def duration(self) -> float:
        """Its duration [s]."""
        return float(self.times[-1])

    def at(self, time: Floats) -> Floats:
        """Return the pressures at some times [Pa], shape (samples, chambers)."""
        return np.column_stack([np.interp(time, self.times, column) for column in self.pressures.T])

    def force_at(self, time: Floats) -> Floats:
        """Return the force on the last section at some times [N], shape (samples, 3)."""
        if self.forces is None:
            return np.zeros((len(time), 3))
        return np.column_stack([np.interp(time, self.times, column) for column in self.forces.T])


class ManoeuvrePath:
    """Points of a manoeuvre, collected one after another, none faster than the limits allow."""

    def __init__(self, limits: ManoeuvreLimits) -> None:
        self._limits = limits
        self._times = [0.0]
        self._points: list[Floats] = [np.zeros(len(limits.pressures))]

    def go(self, level: Floats, seconds: float = 0.0) -> "ManoeuvrePath":
        """Go to a level in some seconds, or as fast as the slew allows."""
        change = float(np.abs(level - self._points[-1]).max(initial=0.0))
        fastest = change / self._limits.slew
        if change == 0.0 and seconds == 0.0:
            return self
        self._times.append(self._times[-1] + max(seconds, fastest))
        self._points.append(level)
        return self

    def hold(self, seconds: float) -> "ManoeuvrePath":
        """Stay."""
        return self.go(self._points[-1], seconds)

    def vent(self, seconds: float = 0.0) -> "ManoeuvrePath":
        """Go to no pressure."""
        return self.go(np.zeros_like(self._points[-1]), seconds)

    def manoeuvre(
        self, name: str, shows: str, by_hand: str = "", rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> Manoeuvre:
        """Make a manoeuvre of the points."""
        return Manoeuvre(name, shows, np.array(self._times), np.array(self._points), by_hand, rotation)
