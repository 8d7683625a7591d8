"""Objectives of the inverse problem, each a weighted sum of squares of the inputs' change.

At an iterate every objective gives rows r - J du with covariance R; the problem is to minimise the sum of
(r - J du)^T R^-1 (r - J du) over the change du of the inputs.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.model import Frames
from softarm.estimator.sensing import SensorSuite
from softarm.estimator.small_matrices import invert


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
    """

    name: str
    data: bool
    innovation: Floats
    jacobian: Floats
    information: Floats
    members: NDArray[np.int64]
    weighted: Floats
    normal: Floats

    @property
    def cost(self) -> float:
        """Weighted sum of squares at the iterate."""
        return float(self.innovation @ self.information @ self.innovation)

    @property
    def gradient(self) -> Floats:
        """J^T R^-1 r, shape (inputs,)."""
        gradient: Floats = self.weighted @ self.innovation
        return gradient

    def moved(self, change: Floats) -> "WeightedRows":
        """Return the rows after a change of the inputs, shape (inputs,)."""
        return WeightedRows(
            self.name, self.data, self.innovation - self.jacobian @ change, self.jacobian, self.information,
            self.members, self.weighted, self.normal,
        )  # fmt: skip


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
        return self.suite.own_noise(self.readings)

    def rows(self, at: Iterate) -> WeightedRows:
        """Linearise at an iterate; rows of absent sensors are left out."""
        observation = self.suite.observe(at.frames, self.readings, self._own_noise)
        drift, motion = at.response(observation.twists)
        innovation = observation.innovation - drift
        information = np.empty_like(observation.covariance)
        invert(observation.covariance, information)
        weighted = motion.T @ information
        return WeightedRows(
            "sensors", True, innovation, motion, information, observation.rows, weighted, weighted @ motion
        )


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
        chambers, pressures, information = self._measured
        innovation, jacobian = pressures - at.vector[chambers], np.eye(len(at.vector))[chambers]
        weighted = jacobian.T @ information
        return WeightedRows(
            self.name, self.data, innovation, jacobian, information, chambers, weighted, weighted @ jacobian
        )

    @cached_property
    def _measured(self) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Chambers that were measured, their pressures, and the information of these."""
        chambers = np.flatnonzero(np.isfinite(self.pressures))
        return chambers, self.pressures[chambers], np.diag(1.0 / self.sigma[chambers] ** 2)


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
        size = len(at.vector)
        unit, information = np.eye(size), self.information
        return WeightedRows(
            "prior",
            False,
            self.mean - at.vector,
            unit,
            information,
            np.arange(size),
            information,
            information,
        )
