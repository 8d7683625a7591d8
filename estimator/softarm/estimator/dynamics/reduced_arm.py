"""The arm in as many coordinates as there are unknown forces.

Each coordinate is the displacement that a force does work on. The arm's shapes under unit forces are the
Ritz vectors (E. L. Wilson, M.-W. Yuan and J. M. Dickens, Earthquake Eng. Struct. Dyn. 10, 1982): with C the
compliance of these displacements, J the motion of the sections under unit forces and m the masses,
K = C^-1 and M = K (sum of J^T m J) K.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.inverse import ArmEstimate
from softarm.estimator.model import Load
from softarm.estimator.simulation.inertia import Masses, mass_kernel
from softarm.estimator.simulation.segments import Neighbours
from softarm.estimator.small_matrices import add_congruence, factorise, invert, product, solve_factored


@dataclass(frozen=True)
class ReducedArm:
    """Stiffness and mass about a pose, and where the arm is.

    Args:
        stiffness: K, symmetric, shape (forces, forces) [N/m].
        mass: M, shape (forces, forces) [kg].
        displacement: Along each force from the base [m], shape (forces,).
        unloaded: The same at rest without these forces [m], shape (forces,).
        forces: Those that would hold the arm in this pose at rest [N], shape (forces,).
        noise: Covariance of the sensors' noise in them [N2], shape (forces, forces).
        members: Rows of the readings that are present, shape (rows,).
        misfit: Squares of their residuals over their noise, over the degrees of freedom.
        slowest: Lowest natural angular frequency or a little less [rad/s] (Dunkerley, Phil. Trans. A 185,
            1894).
    """

    stiffness: Floats
    mass: Floats
    displacement: Floats
    unloaded: Floats
    forces: Floats
    noise: Floats
    members: Indices
    misfit: float
    slowest: float


@dataclass(frozen=True)
class Reduction:
    """How an arm is reduced to the displacements of its loads.

    Args:
        axes: Direction of each force, shape (forces, 3).
        places: Section of each, shape (forces,).
        neighbours: Sections above and below each segment, shape (segments, 2).
        masses: Of sections and segments.
    """

    axes: Floats
    places: Indices
    neighbours: Indices
    masses: Masses

    @classmethod
    def of(
        cls, loads: Sequence[Load], sections: tuple[str, ...], neighbours: Neighbours, masses: Masses
    ) -> "Reduction":
        """Reduce to the displacements of forces on sections."""
        places = [sections.index(load.section) for load in loads if load.section is not None]
        return cls(
            np.array([load.direction for load in loads], dtype=np.float64),
            np.array(places, dtype=np.int64),
            np.array(neighbours, dtype=np.int64).reshape(-1, 2),
            masses,
        )

    def at(self, estimate: ArmEstimate[Any], sensor_noise: Floats) -> ReducedArm | None:
        """Reduce the arm in the pose of an estimate.

        Args:
            estimate: At one instant.
            sensor_noise: Covariance of the sensors' own noise, shape (rows, rows) of the whole suite.

        Returns:
            The reduced arm, ``None`` where no sensor gave a reading or the forces do not each move the arm
            their way.
        """
        sensor_rows = next((row for row in estimate.rows if row.name == "sensors" and len(row.members)), None)
        if sensor_rows is None:
            return None
        count, forces = len(self.axes), estimate.inputs.loads
        stiffness, mass, displacement, unloaded, slowest = _reduce(
            estimate.frames.positions, estimate.motion, self.axes, self.places, self.neighbours,
            self.masses.sections, self.masses.segments, forces,
        )  # fmt: skip
        if slowest < 0.0:
            return None
        noise, squares = _noise_and_squares(
            estimate.covariance[-count:],
            sensor_rows.weighted,
            sensor_noise,
            sensor_rows.members,
            sensor_rows.innovation,
        )
        misfit = squares / max(len(sensor_rows.members) - count, 1)
        return ReducedArm(
            stiffness, mass, displacement, unloaded, forces, noise, sensor_rows.members, misfit, slowest
        )


@njit(cache=True, nogil=True)
def _reduce(
    positions: Floats,
    twists: Floats,
    axes: Floats,
    places: Indices,
    neighbours: Indices,
    sections: Floats,
    segments: Floats,
    forces: Floats,
) -> tuple[Floats, Floats, Floats, Floats, float]:
    """Return K, M, both displacements and the lowest frequency, -1 where C is not positive definite."""
    count = len(axes)
    compliance, lower, stiffness = (
        np.zeros((count, count)),
        np.empty((count, count)),
        np.empty((count, count)),
    )
    mass, displacement, unloaded = np.zeros((count, count)), np.zeros(count), np.empty(count)
    motion = np.empty((1, len(positions), 6, count))
    for section in range(len(positions)):
        for k in range(6):
            for c in range(count):
                motion[0, section, k, c] = twists[6 * section + k, twists.shape[1] - count + c]
    for r in range(count):
        for c in range(count):
            for k in range(3):
                compliance[r, c] += 0.5 * axes[r, k] * motion[0, places[r], k, c]
                compliance[r, c] += 0.5 * axes[c, k] * motion[0, places[c], k, r]
    if not factorise(compliance, lower):
        return stiffness, mass, displacement, unloaded, -1.0
    invert(compliance, stiffness)
    weight, trace = np.zeros((1, count, count)), 0.0
    mass_kernel(
        positions.copy().reshape(1, len(positions), 3), motion, neighbours, sections, segments, weight
    )
    add_congruence(1.0, stiffness, weight[0], mass)
    for r in range(count):
        for k in range(3):
            displacement[r] += axes[r, k] * positions[places[r], k]
        unloaded[r] = displacement[r]
        for c in range(count):
            unloaded[r] -= compliance[r, c] * forces[c]
            trace += weight[0, r, c] * stiffness[c, r]
    return stiffness, mass, displacement, unloaded, 1.0 / math.sqrt(trace)


@njit(cache=True, nogil=True)
def _noise_and_squares(
    covariance: Floats, weighted: Floats, sensor_noise: Floats, members: Indices, residuals: Floats
) -> tuple[Floats, float]:
    """Compute the covariance of the loads by the sensors' noise, and the squares of the residuals over it.

    Args:
        covariance: Of the estimated loads with all inputs, shape (loads, inputs).
        weighted: J^T R^-1 of the sensors' rows, shape (inputs, rows).
        sensor_noise: Covariance of the sensors' noise, shape (all rows, all rows).
        members: Rows that are present, shape (rows,).
        residuals: Measured minus estimated of these rows, shape (rows,).

    Returns:
        Covariance, shape (loads, loads), and the sum of squares.
    """
    count, rows = len(covariance), len(members)
    gain, present, noise = np.empty((count, rows)), np.empty((rows, rows)), np.zeros((count, count))
    product(covariance, weighted, gain)
    for r in range(rows):
        for c in range(rows):
            present[r, c] = sensor_noise[members[r], members[c]]
    add_congruence(1.0, gain, present, noise)
    lower, weighed, squares = np.empty((rows, rows)), residuals.copy(), 0.0
    factorise(present, lower)
    solve_factored(lower, weighed)
    for r in range(rows):
        squares += residuals[r] * weighed[r]
    return noise, squares
