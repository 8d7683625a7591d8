"""The kinds of inverse problem, each as objectives and limits."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.inverse.estimate import ArmEstimate, make_estimate
from softarm.estimator.inverse.limits import InputBounds
from softarm.estimator.inverse.minimise import Linearised, Tolerances, minimise
from softarm.estimator.inverse.objectives import Objective, PressureReadings, Prior, SensorObjective
from softarm.estimator.inverse.unknowns import Unknowns
from softarm.estimator.model import ArmModel, Inputs, Linearisation
from softarm.estimator.sensing import SensorSuite

State = TypeVar("State")
Step = TypeVar("Step", bound=Linearisation)


@dataclass(frozen=True)
class Problem:
    """Objectives and limits of one instant.

    Args:
        unknowns: Names and scales of the inputs.
        suite: The sensors.
        objectives: What the inputs should meet.
        limits: Bounds and held inputs.
        gravity: Gravitational acceleration in the base frame [m/s2], shape (3,).
    """

    unknowns: Unknowns
    suite: SensorSuite
    objectives: tuple[Objective, ...]
    limits: InputBounds
    gravity: Floats

    def solve(
        self,
        model: ArmModel[State, Step],
        start: tuple[State, Inputs],
        tolerances: Tolerances | None = None,
        begun: Linearised[State] | None = None,
    ) -> ArmEstimate[State]:
        """Search from a state and inputs, or from where an earlier search left off if that serves."""
        state, inputs = start
        inputs = Inputs(inputs.pressures, inputs.loads, self.gravity)
        start = (state, inputs)
        found = minimise(model, self.unknowns, self.objectives, self.limits, start, tolerances, begun)
        return make_estimate(found, self.unknowns, self.limits, self.gravity, self.suite)


def independent_prior(unknowns: Unknowns, load_sigma: Floats | float) -> Prior:
    """Assume loads about zero, each alone.

    Args:
        unknowns: Names and scales of the inputs.
        load_sigma: Standard deviation of each load [N or N m], one number or shape (loads,).
    """
    information = np.zeros((unknowns.size, unknowns.size))
    loads = np.arange(unknowns.chambers, unknowns.size)
    information[loads, loads] = (
        1.0 / np.broadcast_to(np.asarray(load_sigma, dtype=np.float64), len(loads)) ** 2
    )
    return Prior(np.zeros(unknowns.size), information)


def forces_problem(
    unknowns: Unknowns,
    suite: SensorSuite,
    readings: Floats,
    pressures: Floats,
    pressure_sigma: Floats | None,
    prior: Prior,
    gravity: Floats,
) -> Problem:
    """Ask for the loads, the pressures known.

    Args:
        unknowns: Names and scales of the inputs.
        suite: The sensors.
        readings: Stacked readings, shape (readings,).
        pressures: Gauge pressures in the chambers [Pa], shape (chambers,).
        pressure_sigma: Their standard deviations [Pa], shape (chambers,); ``None`` takes them as exact.
        prior: Assumption about the loads.
        gravity: Gravitational acceleration in the base frame [m/s2], shape (3,).
    """
    chambers = slice(0, unknowns.chambers)
    limits = InputBounds.free(unknowns.size)
    objectives: tuple[Objective, ...] = (SensorObjective(suite, readings), prior)
    if pressure_sigma is None:
        limits = limits.hold(chambers, pressures)
    else:
        objectives = (*objectives, PressureReadings(pressures, pressure_sigma))
    return Problem(unknowns, suite, objectives, limits, gravity)
