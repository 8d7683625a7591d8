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
from softarm.estimator.small_matrices import add_congruence, invert, product

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
        mean, covariance = np.empty_like(self.mean), np.empty_like(self.covariance)
        weights = self.weights.copy()
        _advance(
            self.mean, self.covariance, weights, seconds, self.unloaded, RATES, arm.mass, arm.stiffness,
            arm.noise, arm.forces, arm.unloaded, mean, covariance,
        )  # fmt: skip
        return ForceFilter(mean, covariance, weights, arm.unloaded)

    @property
    def forces(self) -> tuple[Floats, Floats]:
        """Mean [N], shape (forces,), and covariance, shape (forces, forces), over all filters."""
        count = len(self.unloaded)
        means, within = self.mean[:, 2 * count :], self.covariance[:, 2 * count :, 2 * count :]
        mean: Floats = self.weights @ means
        apart = means - mean
        spread: Floats = (self.weights @ within.reshape(len(within), -1)).reshape(count, count)
        return mean, spread + (self.weights[:, None] * apart).T @ apart


@njit(cache=True, nogil=True)
def _advance(
    means: Floats,
    covariances: Floats,
    weights: Floats,
    seconds: float,
    rest: Floats,
    rates: Floats,
    mass: Floats,
    stiffness: Floats,
    noise: Floats,
    forces: Floats,
    unloaded: Floats,
    mean: Floats,
    covariance: Floats,
) -> None:
    """Fill the means and covariances of the filters at the next instant, and change their weights.

    Args:
        means: At the last instant, shape (filters, size).
        covariances: Likewise, shape (filters, size, size).
        weights: Changed, shape (filters,).
        seconds: Time between the two [s].
        rest: Displacements without the forces at the last instant [m], shape (forces,).
        rates: Of each filter, shape (filters,).
        mass: See ``ReducedArm``, as for all that follow.
        stiffness: Shape (forces, forces).
        noise: Shape (forces, forces).
        forces: Shape (forces,).
        unloaded: Shape (forces,).
        mean: Filled, shape (filters, size).
        covariance: Filled, shape (filters, size, size).
    """
    size, count = means.shape[1], len(forces)
    step, implicit = np.empty((size, size)), np.empty((size, size))
    pushed, wandering, fit = np.zeros(size), np.zeros((size, size)), np.empty(len(weights))
    _mix(means, covariances, weights, np.exp(-seconds / DWELL_S), mean, covariance)
    _trapezoidal(mass, stiffness, seconds, DAMPING_RATIO, step, implicit)
    # At rest without forces the displacements stay: what pushes them there is what the step takes away.
    for r in range(size):
        for k in range(count):
            between = 0.5 * (rest[k] + unloaded[k])
            pushed[r] -= step[r, k] * between
            if r == k:
                pushed[r] += between
        for c in range(size):
            for k in range(2 * count, size):
                wandering[r, c] += seconds * implicit[r, k] * implicit[c, k]
    _predict(step, pushed, wandering, rates, mean, covariance)
    _correct(stiffness, noise, forces, unloaded, mean, covariance, fit)
    best, total = fit.max(), 0.0
    for i in range(len(weights)):
        weights[i] *= np.exp(fit[i] - best)
        total += weights[i]
    for i in range(len(weights)):
        weights[i] /= total


@njit(cache=True, nogil=True)
def _mix(
    means: Floats, covariances: Floats, weights: Floats, stay: float, mean: Floats, covariance: Floats
) -> None:
    """Let the force take on another rate meanwhile: each filter begins at a mixture of all."""
    filters, size = means.shape
    change, before = (1.0 - stay) / (filters - 1), weights.copy()
    mean.fill(0.0)
    covariance.fill(0.0)
    for i in range(filters):
        weights[i] = 0.0
        for j in range(filters):
            weights[i] += (stay if i == j else change) * before[j]
        for j in range(filters):
            share = (stay if i == j else change) * before[j] / weights[i]
            for r in range(size):
                mean[i, r] += share * means[j, r]
        for j in range(filters):
            share = (stay if i == j else change) * before[j] / weights[i]
            for r in range(size):
                apart = means[j, r] - mean[i, r]
                for c in range(size):
                    between = apart * (means[j, c] - mean[i, c])
                    covariance[i, r, c] += share * (covariances[j, r, c] + between)


@njit(cache=True, nogil=True)
def _trapezoidal(
    mass: Floats, stiffness: Floats, seconds: float, damping_ratio: float, step: Floats, implicit: Floats
) -> None:
    """Fill the step (1 - A dt/2)^-1 (1 + A dt/2) of displacements, speeds and forces, and its first part."""
    count, size, half = len(mass), len(step), 0.5 * seconds
    lighter, pulled, square = np.empty((count, count)), np.empty((count, count)), 0.0
    invert(mass, lighter)
    product(lighter, stiffness, pulled)
    for k in range(count):
        square += pulled[k, k] / count
    damping = 2.0 * damping_ratio / np.sqrt(square)
    ahead, behind = np.zeros((size, size)), np.zeros((size, size))
    for r in range(count):
        speed = count + r
        ahead[r, speed], behind[r, speed] = half, -half
        for c in range(count):
            ahead[speed, c] = -half * pulled[r, c]
            ahead[speed, count + c] = -half * damping * pulled[r, c]
            ahead[speed, 2 * count + c] = half * lighter[r, c]
        for c in range(size):
            behind[speed, c] = -ahead[speed, c]
    for k in range(size):
        ahead[k, k] += 1.0
        behind[k, k] += 1.0
    invert(behind, implicit)
    product(implicit, ahead, step)


@njit(cache=True, nogil=True)
def _predict(
    step: Floats, pushed: Floats, wandering: Floats, rates: Floats, mean: Floats, covariance: Floats
) -> None:
    """Carry motion and forces on by the trapezoidal rule, which neither damps nor diverges.

    Args:
        step: As of ``_trapezoidal``, shape (size, size).
        pushed: Effect of the arm's pressures and weight, shape (size,).
        wandering: Covariance gained by forces that wander by one newton a second, shape (size, size).
        rates: Of each filter, shape (filters,).
        mean: Changed, shape (filters, size).
        covariance: Likewise, shape (filters, size, size).
    """
    size = len(step)
    moved, gained = np.empty(size), np.empty((size, size))
    for i in range(len(mean)):
        for r in range(size):
            moved[r] = pushed[r]
            for c in range(size):
                moved[r] += step[r, c] * mean[i, c]
                gained[r, c] = rates[i] ** 2 * wandering[r, c]
        add_congruence(1.0, step, covariance[i], gained)
        for r in range(size):
            mean[i, r] = moved[r]
            for c in range(size):
                covariance[i, r, c] = gained[r, c]


@njit(cache=True, nogil=True)
def _correct(
    stiffness: Floats,
    noise: Floats,
    forces: Floats,
    unloaded: Floats,
    mean: Floats,
    covariance: Floats,
    fit: Floats,
) -> None:
    """Compare the forces that would hold the pose at rest, K (u - u_0), with those estimated.

    Args:
        stiffness: K, shape (forces, forces).
        noise: Covariance of the noise, shape (forces, forces).
        forces: Estimated for an arm at rest, shape (forces,).
        unloaded: u_0, shape (forces,).
        mean: Changed, shape (filters, size).
        covariance: Likewise, shape (filters, size, size).
        fit: Filled with the logarithm of the likelihood of each filter, shape (filters,).
    """
    count, size = len(forces), mean.shape[1]
    seen, spread = np.empty((count, size)), np.empty((count, count))
    precision, innovation = np.empty((count, count)), np.empty(count)
    gain = np.empty((size, count))
    for i in range(len(mean)):
        product(stiffness, covariance[i, :count], seen)
        product(seen[:, :count], stiffness, spread)
        for r in range(count):
            innovation[r] = forces[r]
            for k in range(count):
                spread[r, k] += noise[r, k]
                innovation[r] -= stiffness[r, k] * (mean[i, k] - unloaded[k])
        fit[i] = -0.5 * invert(spread, precision)
        for r in range(count):
            for c in range(count):
                fit[i] -= 0.5 * innovation[r] * precision[r, c] * innovation[c]
        product(seen.T, precision, gain)
        for r in range(size):
            for k in range(count):
                mean[i, r] += gain[r, k] * innovation[k]
        _subtract(gain, seen, covariance[i])


@njit(cache=True, nogil=True)
def _subtract(gain: Floats, seen: Floats, covariance: Floats) -> None:
    """Subtract the gain times what is seen; the covariance stays symmetric."""
    for r in range(len(covariance)):
        for c in range(r + 1):
            for k in range(len(seen)):
                covariance[r, c] -= gain[r, k] * seen[k, c]
            covariance[c, r] = covariance[r, c]
