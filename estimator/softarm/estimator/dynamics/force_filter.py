"""A filter for the forces on an arm that vibrates.

With u the displacements of a reduced arm and u_0 those it would have at rest without the forces f,
M u'' = f - D u' - K (u - u_0), D = 2 zeta / omega K, while f wanders as a random walk. A force rests most of
the time and changes fast when somebody pushes: several filters, each with a rate of change of its own, run
beside each other and are mixed by how well they predict the measurements (the interacting multiple model of
H. A. P. Blom and Y. Bar-Shalom, IEEE Trans. Autom. Control 33, 1988).
"""

from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.dynamics.reduced_arm import ReducedArm

RATES = np.array([0.01, 0.1, 1.0])
"""By how much a force wanders in one second, by filter [N]: a weight, a gauge on its stage, a push."""
DWELL_S = 10.0
"""Mean time for which a force goes on changing at one of these rates [s]. A force that moves is found as well
with 1 s and with 30 s; a short time widens the deviation of one that rests."""
DAMPING_RATIO = 0.06
"""Of the free vibration of a silicone beam at large amplitude."""
START_SPEED = 0.1
START_FORCE = 1.0
"""Standard deviations of speeds [m/s] and forces [N] before anything is known of them."""


@dataclass(frozen=True)
class ForceFilter:
    """What is known of displacements, speeds and forces at one instant.

    Args:
        mean: Of each filter, shape (filters, 3 forces).
        covariance: Shape (filters, 3 forces, 3 forces).
        weights: Probability of each filter, shape (filters,).
        unloaded: Displacements of the arm at rest without the forces [m], shape (forces,).
    """

    mean: Floats
    covariance: Floats
    weights: Floats
    unloaded: Floats

    @classmethod
    def begin(cls, arm: ReducedArm) -> "ForceFilter":
        """Begin at an instant with nothing known of the past."""
        count, filters = len(arm.forces), len(RATES)
        compliance = np.linalg.inv(arm.stiffness)
        mean = np.concatenate([arm.displacement, np.zeros(count), arm.forces])
        covariance = np.diag(np.repeat([0.0, START_SPEED**2, START_FORCE**2], count))
        covariance[:count, :count] = compliance @ arm.noise @ compliance
        weights = np.full(filters, 1.0 / filters)
        return cls(np.tile(mean, (filters, 1)), np.tile(covariance, (filters, 1, 1)), weights, arm.unloaded)

    def at(self, arm: ReducedArm, seconds: float) -> "ForceFilter":
        """Return what is known at the next instant, ``seconds`` later."""
        return self._mixed(seconds)._predicted(arm, seconds)._corrected(arm)

    @property
    def forces(self) -> tuple[Floats, Floats]:
        """Mean [N], shape (forces,), and covariance, shape (forces, forces), over all filters."""
        count = len(self.unloaded)
        means = self.mean[:, 2 * count :]
        mean: Floats = self.weights @ means
        apart = means - mean
        within = _weighed(self.weights, self.covariance[:, 2 * count :, 2 * count :])
        return mean, within + (self.weights[:, None] * apart).T @ apart

    def _mixed(self, seconds: float) -> "ForceFilter":
        """Let the force take on another rate meanwhile: each filter begins at a mixture of all."""
        filters = len(self.weights)
        stay = np.exp(-seconds / DWELL_S)
        change = np.full((filters, filters), (1.0 - stay) / (filters - 1))
        np.fill_diagonal(change, stay)
        ahead = change @ self.weights
        shares = change * self.weights / ahead[:, None]
        means = shares @ self.mean
        apart = self.mean - means[:, None]
        between = (shares[:, :, None] * apart).transpose(0, 2, 1) @ apart
        return replace(
            self, mean=means, covariance=_weighed(shares, self.covariance) + between, weights=ahead
        )

    def _predicted(self, arm: ReducedArm, seconds: float) -> "ForceFilter":
        """Carry motion and forces on by the trapezoidal rule, which neither damps nor diverges."""
        count = len(arm.forces)
        size, speeds = 3 * count, slice(count, 2 * count)
        lighter = np.linalg.inv(arm.mass)
        pulled = lighter @ arm.stiffness
        frequency = np.sqrt(np.trace(pulled) / count)
        rate = np.zeros((size, size))
        rate[:count, speeds] = np.eye(count)
        rate[speeds] = np.hstack([-pulled, -2.0 * DAMPING_RATIO / frequency * pulled, lighter])
        drive = np.zeros(size)
        drive[speeds] = pulled @ (0.5 * (self.unloaded + arm.unloaded))
        half = 0.5 * seconds * rate
        implicit = np.linalg.inv(np.eye(size) - half)
        step = implicit @ (np.eye(size) + half)
        wandering = implicit[:, 2 * count :]
        wander = seconds * wandering @ wandering.T
        return replace(
            self,
            mean=self.mean @ step.T + seconds * implicit @ drive,
            covariance=step @ self.covariance @ step.T + RATES[:, None, None] ** 2 * wander,
        )

    def _corrected(self, arm: ReducedArm) -> "ForceFilter":
        """Compare the forces that would hold the pose at rest, K (u - u_0), with those estimated."""
        count = len(arm.forces)
        seen = arm.stiffness @ self.covariance[:, :count]
        spread = seen[:, :, :count] @ arm.stiffness + arm.noise
        innovation = arm.forces - (self.mean[:, :count] - arm.unloaded) @ arm.stiffness
        precision = np.linalg.inv(spread)
        gain = seen.transpose(0, 2, 1) @ precision
        corrected = self.covariance - gain @ seen
        squares = np.einsum("ki,kij,kj->k", innovation, precision, innovation)
        fit = np.log(self.weights) - 0.5 * (squares + np.linalg.slogdet(spread)[1])
        likely = np.exp(fit - fit.max())
        return ForceFilter(
            self.mean + np.einsum("kij,kj->ki", gain, innovation),
            0.5 * (corrected + corrected.transpose(0, 2, 1)),
            likely / likely.sum(),
            arm.unloaded,
        )


def _weighed(shares: Floats, matrices: Floats) -> Floats:
    """Return weighted sums of matrices, shape (..., n, n), by shares, shape (..., filters)."""
    sums: Floats = shares @ matrices.reshape(len(matrices), -1)
    return sums.reshape(*shares.shape[:-1], *matrices.shape[1:])
