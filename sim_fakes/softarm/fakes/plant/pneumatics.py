"""From the valves' outlets to the pressures that act in the arm."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.parameters import Actuation, ArmParameters

REFERENCE_PRESSURE = 50e3
BUCKLING_WIDTH = 0.03


@dataclass(frozen=True)
class Lines:
    """First-order lines with leaks: dp/dt = (p_valve - p) / lag - leak p.

    Args:
        follow: Share of the way to the steady pressure in one step, shape (chambers,).
        level: Steady pressure over that of the valve, shape (chambers,).
    """

    follow: Floats
    level: Floats

    def step(self, pressures: Floats, valve_pressures: Floats) -> Floats:
        """Step the chamber pressures [Pa] under constant valve pressures, shape (chambers,)."""
        return pressures + self.follow * (self.level * valve_pressures - pressures)


def lines(actuation: Actuation, step: float) -> Lines:
    """Make the lines of an arm for one time step [s]; the step is exact for a constant valve pressure."""
    lags, leaks = np.array(actuation.lags), np.array(actuation.leak_rates)
    return Lines(follow=-np.expm1(-step * (1.0 / lags + leaks)), level=1.0 / (1.0 + leaks * lags))


@dataclass(frozen=True)
class EffectivePressure:
    """The effective pressure of each chamber.

    Args:
        mixing: Gains on the diagonal, cross-talk beside it, shape (chambers, chambers).
        neighbours: 1 where two chambers lie in the same segment, 0 on the diagonal, of the same shape.
        actuation: The constants of the nonlinear terms.
    """

    mixing: Floats
    neighbours: Floats
    actuation: Actuation

    def effective(self, pressures: Floats) -> Floats:
        """Return the pressures that would push as much on the drawn area [Pa]."""
        actuation = self.actuation
        effective = pressures * (1.0 + actuation.growth * pressures / REFERENCE_PRESSURE)
        if actuation.buckling_pressure > 0.0:
            past = (pressures / actuation.buckling_pressure - 1.0) / BUCKLING_WIDTH
            effective = effective * (1.0 + 0.5 * actuation.buckling * (1.0 + np.tanh(past)))
        if actuation.product != 0.0:
            others = self.neighbours @ pressures
            effective = effective * (1.0 + actuation.product * others / REFERENCE_PRESSURE)
        return self.mixing @ effective


def effective_pressure(arm: ArmParameters) -> EffectivePressure:
    """Make the map from chamber pressures to effective pressures."""
    neighbours = np.zeros((arm.chambers, arm.chambers))
    for group in arm.groups:
        neighbours[np.ix_(group, group)] = 1.0
    np.fill_diagonal(neighbours, 0.0)
    mixing = np.diag(arm.actuation.gains) + np.array(arm.actuation.crosstalk)
    return EffectivePressure(mixing, neighbours, arm.actuation)
