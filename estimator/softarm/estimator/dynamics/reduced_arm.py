"""The arm in as many coordinates as there are unknown forces.

Each coordinate is the displacement that a force does work on. The arm's shapes under unit forces are the
Ritz vectors (E. L. Wilson, M.-W. Yuan and J. M. Dickens, Earthquake Eng. Struct. Dyn. 10, 1982): with C the
compliance of these displacements, J the motion of the sections under unit forces and m the masses,
K = C^-1 and M = K (sum of J^T m J) K.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.inverse import ArmEstimate
from softarm.estimator.model import Frames, Load
from softarm.estimator.simulation.inertia import Masses, mass_matrix
from softarm.estimator.simulation.segments import Neighbours
from softarm.estimator.small_matrices import add_congruence, factorise, invert


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
    """

    stiffness: Floats
    mass: Floats
    displacement: Floats
    unloaded: Floats
    forces: Floats
    noise: Floats

    @property
    def slowest(self) -> float:
        """Lowest natural angular frequency or a little less [rad/s] (Dunkerley, Phil. Trans. A 185, 1894)."""
        return float(1.0 / np.sqrt(np.trace(np.linalg.solve(self.stiffness, self.mass))))


def reduced(
    estimate: ArmEstimate[Any],
    loads: tuple[Load, ...],
    sections: tuple[str, ...],
    neighbours: Neighbours,
    masses: Masses,
    own_noise: Floats,
) -> ReducedArm | None:
    """Reduce the arm to the displacements of its loads.

    Args:
        estimate: At one instant.
        loads: Forces on sections.
        sections: Names of the sections.
        neighbours: Sections above and below each segment.
        masses: Of sections and segments.
        own_noise: Covariance of the sensors' own noise, shape (rows, rows) of the whole suite.

    Returns:
        The reduced arm, ``None`` where no sensor gave a reading or the forces do not each move the arm their
        way.
    """
    if not any(row.name == "sensors" and len(row.members) for row in estimate.rows):
        return None
    chambers, count = estimate.unknowns.chambers, len(loads)
    motion = estimate.motion[:, chambers:].reshape(len(sections), 6, count)
    axes = np.array([load.direction for load in loads])
    places = [sections.index(load.section) for load in loads if load.section is not None]
    frames = Frames(estimate.frames.positions[None], estimate.frames.rotations[None])
    weight = mass_matrix(frames, neighbours, masses, motion[None])[0]
    compliance, stiffness, mass = (np.empty((count, count)) for _ in range(3))
    if not _reduce(motion, axes, np.array(places), weight, compliance, stiffness, mass):
        return None
    displacement = (axes * estimate.frames.positions[places]).sum(axis=1)
    forces = estimate.inputs.loads
    noise = _noise(estimate, own_noise)
    return ReducedArm(stiffness, mass, displacement, displacement - compliance @ forces, forces, noise)


@njit(cache=True, nogil=True)
def _reduce(
    motion: Floats,
    axes: Floats,
    places: Indices,
    weight: Floats,
    compliance: Floats,
    stiffness: Floats,
    mass: Floats,
) -> bool:
    """Fill C, K and M; return whether C is positive definite."""
    count, lower = len(axes), np.empty_like(compliance)
    for r in range(count):
        for c in range(count):
            compliance[r, c] = 0.0
            for k in range(3):
                compliance[r, c] += 0.5 * axes[r, k] * motion[places[r], k, c]
                compliance[r, c] += 0.5 * axes[c, k] * motion[places[c], k, r]
    if not factorise(compliance, lower):
        return False
    invert(compliance, stiffness)
    mass.fill(0.0)
    add_congruence(1.0, stiffness, weight, mass)
    return True


def _noise(estimate: ArmEstimate[Any], own_noise: Floats) -> Floats:
    """Carry the sensors' own noise through the estimate to its loads."""
    covariance = estimate.covariance[estimate.unknowns.chambers :]
    noise = np.zeros((len(covariance), len(covariance)))
    for row in estimate.rows:
        if row.name == "sensors":
            gain = covariance @ row.weighted
            noise += gain @ own_noise[row.members][:, row.members] @ gain.T
    return noise
