"""A filter for the forces on an arm that vibrates.

With u the displacements of a reduced arm and u_0 those it would have at rest without the forces f,
M u'' = f - D u' - K (u - u_0), D = 2 zeta / omega K, while f wanders as a random walk. A force rests most of
the time and changes fast when somebody pushes: several filters, each with a rate of change of its own, run
beside each other and are mixed by how well they predict the measurements (the interacting multiple model of
H. A. P. Blom and Y. Bar-Shalom, IEEE Trans. Autom. Control 33, 1988).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit

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
        mean, covariance, weights = _mixed(self.mean, self.covariance, self.weights, seconds)
        drive = 0.5 * (self.unloaded + arm.unloaded)
        _predict(mean, covariance, arm.mass, arm.stiffness, drive, seconds)
        _correct(mean, covariance, weights, arm.stiffness, arm.forces, arm.unloaded, arm.noise)
        return ForceFilter(mean, covariance, weights, arm.unloaded)

    @property
    def forces(self) -> tuple[Floats, Floats]:
        """Mean [N], shape (forces,), and covariance, shape (forces, forces), over all filters."""
        count = len(self.unloaded)
        means = self.mean[:, 2 * count :]
        mean: Floats = self.weights @ means
        apart = means - mean
        within = np.tensordot(self.weights, self.covariance[:, 2 * count :, 2 * count :], 1)
        return mean, within + (self.weights[:, None] * apart).T @ apart


@njit(cache=True, nogil=True)
def _mixed(
    mean: Floats, covariance: Floats, weights: Floats, seconds: float
) -> tuple[Floats, Floats, Floats]:
    """Let the force take on another rate meanwhile: each filter begins at a mixture of all."""
    filters = len(weights)
    stay = np.exp(-seconds / DWELL_S)
    ahead = (1.0 - stay) / (filters - 1) * (1.0 - weights) + stay * weights
    means, covariances = np.zeros_like(mean), np.zeros_like(covariance)
    for to in range(filters):
        shares = weights * (1.0 - stay) / (filters - 1) / ahead[to]
        shares[to] = weights[to] * stay / ahead[to]
        for source in range(filters):
            means[to] += shares[source] * mean[source]
        for source in range(filters):
            apart = mean[source] - means[to]
            covariances[to] += shares[source] * (covariance[source] + np.outer(apart, apart))
    return means, covariances, ahead


@njit(cache=True, nogil=True)
def _predict(
    mean: Floats, covariance: Floats, mass: Floats, stiffness: Floats, unloaded: Floats, seconds: float
) -> None:
    """Carry motion and forces on by the trapezoidal rule, which neither damps nor diverges; in place."""
    count = len(unloaded)
    size = 3 * count
    lighter = np.linalg.inv(mass)
    pulled = lighter @ stiffness
    frequency = np.sqrt(np.trace(pulled) / count)
    rate = np.zeros((size, size))
    rate[:count, count : 2 * count] = np.eye(count)
    rate[count : 2 * count, :count] = -pulled
    rate[count : 2 * count, count : 2 * count] = -2.0 * DAMPING_RATIO / frequency * pulled
    rate[count : 2 * count, 2 * count :] = lighter
    drive = np.zeros(size)
    drive[count : 2 * count] = pulled @ unloaded
    half = 0.5 * seconds * rate
    implicit = np.linalg.inv(np.eye(size) - half)
    step = implicit @ (np.eye(size) + half)
    wandering = np.ascontiguousarray(implicit[:, 2 * count :])
    wander = seconds * wandering @ wandering.T
    for k in range(len(mean)):
        mean[k] = step @ mean[k] + seconds * implicit @ drive
        covariance[k] = step @ covariance[k] @ step.T + RATES[k] ** 2 * wander


@njit(cache=True, nogil=True)
def _correct(
    mean: Floats,
    covariance: Floats,
    weights: Floats,
    stiffness: Floats,
    forces: Floats,
    unloaded: Floats,
    noise: Floats,
) -> None:
    """Compare the forces that would hold the pose at rest, K (u - u_0), with those estimated; in place."""
    count = len(forces)
    fit = np.zeros(len(weights))
    for k in range(len(weights)):
        seen = stiffness @ np.ascontiguousarray(covariance[k, :count])
        spread = np.ascontiguousarray(seen[:, :count]) @ stiffness + noise
        innovation = forces - stiffness @ (mean[k, :count] - unloaded)
        precision = np.linalg.inv(spread)
        gain = seen.T @ precision
        mean[k] += gain @ innovation
        corrected = covariance[k] - gain @ seen
        covariance[k] = 0.5 * (corrected + corrected.T)
        fit[k] = np.log(weights[k]) - 0.5 * (
            innovation @ precision @ innovation + np.linalg.slogdet(spread)[1]
        )
    likely = np.exp(fit - fit.max())
    weights[:] = likely / likely.sum()
