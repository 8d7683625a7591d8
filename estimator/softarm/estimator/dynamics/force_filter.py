"""A filter for the forces on an arm that vibrates.

With u the displacements of a reduced arm and u_0 those it would have at rest without the forces f,
M u'' = f - D u' - K (u - u_0), D = 2 zeta / omega K. A force follows a random walk, or rises evenly with a
slope that does. Several filters, each with a law of its own, run beside each other and are mixed by how
well they predict the measurements (the interacting multiple model of H. A. P. Blom and Y. Bar-Shalom, IEEE
Trans. Autom. Control 33, 1988).
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from softarm.estimator.arrays import Floats
from softarm.estimator.dynamics.reduced_arm import ReducedArm
from softarm.estimator.small_matrices import add_congruence, invert, product

RATE, SLOPE, DAMPING = range(3)
LAWS = np.array([[0.01, 0.0, 0.06], [0.01, 0.0, 0.12], [0.01, 0.3, 0.12], [1.0, 0.0, 0.06]])
"""By filter: how much a force wanders in one second [N], how much its slope does [N/s], 0 for a force without
slope, and the damping ratio. They stand for a weight on an arm that vibrates far or dies down, a gauge on its
stage, and a push.

A damping ratio of 0.06 is that of the free vibration of a silicone beam at large amplitude; 0.12, for small
and slow motion, was compared with 0.06 and 0.2 on fake arm 2 and holds on arms 1 and 3. A random walk in
place of the slope follows a stage that moves evenly 50 ms late; slopes that wander by 0.1 and by 1 N/s follow
it as well.
"""
DWELL_S = 10.0
"""Mean time for which a force follows one of these laws [s]. A force that moves is estimated as well with 1 s
and with 30 s; a short time widens the deviation of one that rests."""
START_SPEED = 0.1
START_FORCE = 1.0
"""Prior standard deviations of speeds [m/s] and forces [N]."""


@dataclass(frozen=True)
class ForceFilter:
    """Distribution of displacements, speeds, forces and their slopes at one instant.

    Args:
        mean: Of each filter, shape (filters, 4 forces).
        covariance: Shape (filters, 4 forces, 4 forces).
        weights: Probability of each filter, shape (filters,).
        unloaded: Displacements of the arm at rest without the forces [m], shape (forces,).
    """

    mean: Floats
    covariance: Floats
    weights: Floats
    unloaded: Floats

    @classmethod
    def begin(cls, arm: ReducedArm) -> "ForceFilter":
        """Begin at an instant without a past."""
        count, filters = len(arm.forces), len(LAWS)
        compliance = np.linalg.inv(arm.stiffness)
        mean = np.concatenate([arm.displacement, np.zeros(count), arm.forces, np.zeros(count)])
        covariance = np.diag(np.repeat([0.0, START_SPEED**2, START_FORCE**2, 0.0], count))
        covariance[:count, :count] = compliance @ arm.noise @ compliance
        weights = np.full(filters, 1.0 / filters)
        return cls(np.tile(mean, (filters, 1)), np.tile(covariance, (filters, 1, 1)), weights, arm.unloaded)

    def shifted(self, arm: ReducedArm, misfit: float) -> "ForceFilter":
        """Return the same with displacements as uncertain as the misfit of other readings makes them."""
        count, compliance = len(arm.forces), np.linalg.inv(arm.stiffness)
        covariance = self.covariance.copy()
        covariance[:, :count, :count] += misfit * compliance @ arm.noise @ compliance
        return replace(self, covariance=covariance)

    def at(self, arm: ReducedArm, seconds: float) -> "ForceFilter":
        """Return the distribution at the next instant, ``seconds`` later."""
        mean, covariance = np.empty_like(self.mean), np.empty_like(self.covariance)
        weights = self.weights.copy()
        _advance(
            self.mean, self.covariance, weights, seconds, self.unloaded, LAWS, arm.mass, arm.stiffness,
            arm.noise, arm.forces, arm.unloaded, mean, covariance,
        )  # fmt: skip
        return ForceFilter(mean, covariance, weights, arm.unloaded)

    @property
    def forces(self) -> tuple[Floats, Floats]:
        """Mean [N], shape (forces,), and covariance, shape (forces, forces), over all filters."""
        count = len(self.unloaded)
        members = slice(2 * count, 3 * count)
        means, within = self.mean[:, members], self.covariance[:, members, members]
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
    laws: Floats,
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
        laws: As ``LAWS``, shape (filters, 3).
        mass: See ``ReducedArm``, as for all that follow.
        stiffness: Shape (forces, forces).
        noise: Shape (forces, forces).
        forces: Shape (forces,).
        unloaded: Shape (forces,).
        mean: Filled, shape (filters, size).
        covariance: Filled, shape (filters, size, size).
    """
    fit = np.empty(len(weights))
    _mix(means, covariances, weights, np.exp(-seconds / DWELL_S), mean, covariance)
    _predict(mass, stiffness, seconds, laws, 0.5 * (rest + unloaded), mean, covariance)
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
    """Fill the step (1 - A dt/2)^-1 (1 + A dt/2) of place, speed, force and slope, and its first part."""
    count, size, half = len(mass), len(step), 0.5 * seconds
    lighter, pulled, square = np.empty((count, count)), np.empty((count, count)), 0.0
    invert(mass, lighter)
    product(lighter, stiffness, pulled)
    for k in range(count):
        square += pulled[k, k] / count
    damping = 2.0 * damping_ratio / np.sqrt(square)
    ahead, behind = np.zeros((size, size)), np.zeros((size, size))
    for r in range(count):
        speed, force, slope = count + r, 2 * count + r, 3 * count + r
        ahead[r, speed], behind[r, speed] = half, -half
        ahead[force, slope], behind[force, slope] = half, -half
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
    mass: Floats,
    stiffness: Floats,
    seconds: float,
    laws: Floats,
    rest: Floats,
    mean: Floats,
    covariance: Floats,
) -> None:
    """Carry motion and forces on by the trapezoidal rule, which neither damps nor diverges.

    Args:
        mass: M, shape (forces, forces).
        stiffness: K, of the same shape.
        seconds: Length of the step.
        laws: As ``LAWS``, shape (filters, 3).
        rest: Displacements at rest without forces meanwhile, shape (forces,).
        mean: Changed, shape (filters, size).
        covariance: Likewise, shape (filters, size, size).
    """
    count, size = len(mass), mean.shape[1]
    step, implicit = np.empty((size, size)), np.empty((size, size))
    away, gained = np.empty(size), np.empty((size, size))
    for i in range(len(laws)):
        _trapezoidal(mass, stiffness, seconds, laws[i, DAMPING], step, implicit)
        if laws[i, SLOPE] == 0.0:
            mean[i, 3 * count :] = 0.0
            covariance[i, 3 * count :] = 0.0
            covariance[i, :, 3 * count :] = 0.0
        away[:] = mean[i]
        away[:count] -= rest
        mean[i] = 0.0
        mean[i, :count] = rest
        gained.fill(0.0)
        for r in range(size):
            for c in range(size):
                mean[i, r] += step[r, c] * away[c]
                for k in range(count):
                    wander, rise = 2 * count + k, 3 * count + k
                    gained[r, c] += seconds * laws[i, RATE] ** 2 * implicit[r, wander] * implicit[c, wander]
                    gained[r, c] += seconds * laws[i, SLOPE] ** 2 * implicit[r, rise] * implicit[c, rise]
        add_congruence(1.0, step, covariance[i], gained)
        covariance[i] = gained


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
    cross_covariance, spread = np.empty((count, size)), np.empty((count, count))
    precision, innovation = np.empty((count, count)), np.empty(count)
    gain = np.empty((size, count))
    for i in range(len(mean)):
        product(stiffness, covariance[i, :count], cross_covariance)
        product(cross_covariance[:, :count], stiffness, spread)
        for r in range(count):
            innovation[r] = forces[r]
            for k in range(count):
                spread[r, k] += noise[r, k]
                innovation[r] -= stiffness[r, k] * (mean[i, k] - unloaded[k])
        fit[i] = -0.5 * invert(spread, precision)
        for r in range(count):
            for c in range(count):
                fit[i] -= 0.5 * innovation[r] * precision[r, c] * innovation[c]
        product(cross_covariance.T, precision, gain)
        for r in range(size):
            for k in range(count):
                mean[i, r] += gain[r, k] * innovation[k]
        _subtract(gain, cross_covariance, covariance[i])


@njit(cache=True, nogil=True)
def _subtract(gain: Floats, cross_covariance: Floats, covariance: Floats) -> None:
    """Subtract the gain times the cross-covariance; the covariance stays symmetric."""
    for r in range(len(covariance)):
        for c in range(r + 1):
            for k in range(len(cross_covariance)):
                covariance[r, c] -= gain[r, k] * cross_covariance[k, c]
            covariance[c, r] = covariance[r, c]
