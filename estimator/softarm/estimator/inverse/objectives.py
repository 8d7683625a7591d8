"""Objectives of the inverse problem, each a weighted sum of squares of the inputs' change.

At an iterate every objective has rows r - J du with covariance R; the problem is to minimise the sum of
(r - J du)^T R^-1 (r - J du) over the change du of the inputs.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.model import Frames
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.small_matrices import invert, product


@dataclass(frozen=True)
class Iterate:
    """The model linearised at an iterate, which need not be in equilibrium.

    Args:
        frames: Frames of the sections.
        vector: Pressures, then loads, shape (inputs,).
        chambers: Number of pressures.
        response: Projects the motion of the sections on rows; see ``softarm.estimator.model.Linearisation``.
    """

    frames: Frames
    vector: Floats
    chambers: int
    response: Callable[[Floats], tuple[Floats, Floats]]


PRESSURES = "pressures"
"""Name of the rows of measured pressures."""


@dataclass(frozen=True)
class WeightedRows:
    """Linearised rows of one objective.

    Args:
        name: Which objective they belong to.
        data: Whether they are data (readings) or an assumption (a prior, a wish).
        innovation: r, shape (rows,).
        jacobian: J, shape (rows, inputs).
        information: R^-1, shape (rows, rows).
        members: Row of the objective each one is, where some are absent, shape (rows,).
        weighted: J^T R^-1, shape (inputs, rows).
        normal: J^T R^-1 J, shape (inputs, inputs).
        gradient: J^T R^-1 r, shape (inputs,).
        cost: Weighted sum of squares at the iterate.
    """

    name: str
    data: bool
    innovation: Floats
    jacobian: Floats
    information: Floats
    members: NDArray[np.int64]
    weighted: Floats
    normal: Floats
    gradient: Floats
    cost: float

    def moved(self, change: Floats) -> "WeightedRows":
        """Return the rows after a change of the inputs, shape (inputs,)."""
        innovation, gradient = np.empty_like(self.innovation), np.empty_like(self.gradient)
        cost = _move(
            self.innovation, self.jacobian, self.information, self.normal, self.gradient, change,
            innovation, gradient,
        )  # fmt: skip
        return WeightedRows(
            self.name, self.data, innovation, self.jacobian, self.information, self.members, self.weighted,
            self.normal, gradient, cost,
        )  # fmt: skip


@njit(cache=True, nogil=True)
def _move(
    before: Floats,
    jacobian: Floats,
    information: Floats,
    normal: Floats,
    slope: Floats,
    change: Floats,
    innovation: Floats,
    gradient: Floats,
) -> float:
    """Fill r - J du and J^T R^-1 r - J^T R^-1 J du; return the weighted sum of squares there."""
    rows, inputs = jacobian.shape
    for r in range(rows):
        innovation[r] = before[r]
        for c in range(inputs):
            innovation[r] -= jacobian[r, c] * change[c]
    for r in range(inputs):
        gradient[r] = slope[r]
        for c in range(inputs):
            gradient[r] -= normal[r, c] * change[c]
    return _square(innovation, information)


@njit(cache=True, nogil=True)
def _square(innovation: Floats, information: Floats) -> float:
    """Return r^T R^-1 r."""
    total = 0.0
    for r in range(len(innovation)):
        for c in range(len(innovation)):
            total += innovation[r] * information[r, c] * innovation[c]
    return total


@njit(cache=True, nogil=True)
def _weigh(
    innovation: Floats,
    drift: Floats,
    jacobian: Floats,
    covariance: Floats,
    information: Floats,
    weighted: Floats,
    normal: Floats,
    gradient: Floats,
) -> float:
    """Subtract a drift from an innovation and fill what follows from a covariance; return the cost.

    Args:
        innovation: Changed, shape (rows,).
        drift: Shape (rows,).
        jacobian: J, shape (rows, inputs).
        covariance: R, shape (rows, rows).
        information: Filled with R^-1, shape (rows, rows).
        weighted: Filled with J^T R^-1, shape (inputs, rows).
        normal: Filled with J^T R^-1 J, shape (inputs, inputs).
        gradient: Filled with J^T R^-1 r, shape (inputs,).
    """
    for r in range(len(innovation)):
        innovation[r] -= drift[r]
    invert(covariance, information)
    product(jacobian.T, information, weighted)
    product(weighted, jacobian, normal)
    for r in range(len(gradient)):
        gradient[r] = 0.0
        for c in range(len(innovation)):
            gradient[r] += weighted[r, c] * innovation[c]
    return _square(innovation, information)


class Objective(Protocol):
    """Something that the inputs should meet."""

    def rows(self, at: Iterate) -> WeightedRows:
        """Linearise at an iterate."""


@dataclass(frozen=True)
class SensorObjective:
    """Agreement with the readings of one instant.

    Args:
        suite: The sensors.
        readings: Stacked readings, NaN where absent, shape (readings,).
    """

    suite: SensorSuite
    readings: Floats

    @cached_property
    def _own_noise(self) -> Floats:
        # Of the readings alone, so that it serves all linearisations of a search.
        return self.suite.sensor_noise(self.readings)

    def rows(self, at: Iterate) -> WeightedRows:
        """Linearise at an iterate; rows of absent sensors are left out."""
        observation = self.suite.observe(at.frames, self.readings, self._own_noise)
        drift, motion = at.response(observation.twists)
        innovation, covariance = observation.innovation, observation.covariance
        information, weighted = np.empty_like(covariance), np.empty((motion.shape[1], motion.shape[0]))
        normal, gradient = np.empty((len(weighted), len(weighted))), np.empty(len(weighted))
        cost = _weigh(innovation, drift, motion, covariance, information, weighted, normal, gradient)
        return WeightedRows(
            "sensors", True, innovation, motion, information, observation.rows, weighted, normal, gradient,
            cost,
        )  # fmt: skip


@dataclass(frozen=True)
class PressureReadings:
    """Agreement with measured chamber pressures, as far as each was measured.

    Args:
        pressures: Gauge pressures in the chambers [Pa], NaN where not measured, shape (chambers,).
        sigma: Standard deviation of each [Pa], shape (chambers,).
        name: Name of these rows.
        data: False for a mere preference.
    """

    pressures: Floats
    sigma: Floats
    name: str = PRESSURES
    data: bool = True

    def rows(self, at: Iterate) -> WeightedRows:
        """Linearise at an iterate."""
        chambers, size = self._measured, len(at.vector)
        count = len(chambers)
        innovation, jacobian = np.empty(count), np.zeros((count, size))
        information, weighted = np.zeros((count, count)), np.zeros((size, count))
        normal, gradient = np.zeros((size, size)), np.zeros(size)
        cost = _weigh_pressures(
            self.pressures, self.sigma, at.vector, chambers, innovation, jacobian, information, weighted,
            normal, gradient,
        )  # fmt: skip
        return WeightedRows(
            self.name, self.data, innovation, jacobian, information, chambers, weighted, normal, gradient,
            cost,
        )  # fmt: skip

    @cached_property
    def _measured(self) -> NDArray[np.int64]:
        """Chambers that were measured."""
        return np.flatnonzero(np.isfinite(self.pressures))


@njit(cache=True, nogil=True)
def _weigh_pressures(
    pressures: Floats,
    sigma: Floats,
    vector: Floats,
    chambers: Indices,
    innovation: Floats,
    jacobian: Floats,
    information: Floats,
    weighted: Floats,
    normal: Floats,
    gradient: Floats,
) -> float:
    """Fill the rows of measured chambers, zeros to begin with; return their cost."""
    cost = 0.0
    for row in range(len(chambers)):
        k = chambers[row]
        weight = 1.0 / (sigma[k] * sigma[k])
        innovation[row] = pressures[k] - vector[k]
        jacobian[row, k] = 1.0
        # With a unit Jacobian and a diagonal covariance all products are the weights themselves.
        information[row, row] = weighted[k, row] = normal[k, k] = weight
        gradient[k] = weight * innovation[row]
        cost += gradient[k] * innovation[row]
    return cost


@dataclass(frozen=True)
class Prior:
    """A Gaussian assumption about the inputs.

    Args:
        mean: Shape (inputs,).
        information: Inverse of the covariance, zero rows where nothing is assumed, shape (inputs, inputs).
    """

    mean: Floats
    information: Floats

    def rows(self, at: Iterate) -> WeightedRows:
        """Linearise at an iterate."""
        size, information = len(at.vector), self.information
        innovation = self.mean - at.vector
        gradient: Floats = information @ innovation
        return WeightedRows(
            "prior", False, innovation, np.eye(size), information, np.arange(size), information, information,
            gradient, float(innovation @ gradient),
        )  # fmt: skip
