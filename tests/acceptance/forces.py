"""The loads at one instant from readings, as an inverse problem."""

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.inverse import (
    InputBounds,
    Objective,
    PressureReadings,
    Prior,
    Problem,
    SensorObjective,
    Unknowns,
)
from softarm.estimator.sensing import SensorSuite


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
    """Estimate the loads, the pressures known.

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
