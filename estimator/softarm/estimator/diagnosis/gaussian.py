"""The Gaussian distribution of all common coefficients, and what a few more can add to it.

Residuals of all stretches follow r = C (c + d_S) + e: C are the columns of calibration and library, c what
holds for every recording (Gaussian, with mean and precision), d_S the extra coefficients of a
hypothesis, e noise. Marginalising c, the gain of S is T = b_S^T M_SS^-1 b_S with
M = G - G A^-1 G, A = G + P, b = g - G A^-1 (g + P m), G and g the sums of products, P, m the prior.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, block_diag, cho_factor, cho_solve

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.normal_equations import Total

JITTER = 1e-9
RIDGES = (0.0, 1e-9, 1e-7, 1e-5, 1e-3)
"""Added to a unit diagonal until a matrix is positive."""


@dataclass(frozen=True)
class Factor:
    """Cholesky factor of a symmetric matrix scaled to unit diagonal.

    Args:
        factor: Of the scaled matrix.
        size: Roots of the diagonal, shape (columns,).
    """

    factor: tuple[Floats, bool]
    size: Floats

    @classmethod
    def of(cls, matrix: Floats) -> "Factor":
        """Factorise; products in single precision may make a matrix indefinite by their rounding.

        They may leave less than nothing of a column that others stand for; its size is then that of what it
        shares with these.
        """
        diagonal = np.diag(matrix)
        rest = np.abs(matrix).max(axis=0, initial=0.0)
        size = np.sqrt(np.maximum(np.where(diagonal > 0.0, diagonal, rest), 1e-300))
        scaled = _symmetric(matrix / np.outer(size, size))
        diagonal = np.diag(scaled).copy()
        for ridge in RIDGES:
            np.fill_diagonal(scaled, diagonal + ridge)
            try:
                return cls(cho_factor(scaled.T, check_finite=False), size)  # LAPACK counts columns first
            except LinAlgError:
                continue
        np.fill_diagonal(scaled, diagonal)
        values, vectors = np.linalg.eigh(scaled)
        whole = (vectors * np.maximum(values, RIDGES[-1])) @ vectors.T
        return cls(cho_factor(whole), size)

    def solve(self, right: Floats) -> Floats:
        """Solve for right-hand sides, shape (columns,) or (columns, sides)."""
        size = self.size if right.ndim == 1 else self.size[:, None]
        solved: Floats = cho_solve(self.factor, right / size, check_finite=False) / size
        return solved


@dataclass(frozen=True)
class Gaussian:
    """A Gaussian distribution of the common coefficients.

    Args:
        mean: Shape (columns,).
        covariance: Shape (columns, columns).
    """

    mean: Floats
    covariance: Floats

    @cached_property
    def precision(self) -> Floats:
        """Inverse of the covariance."""
        size = np.sqrt(np.diag(self.covariance))
        scaled = self.covariance / np.outer(size, size) + JITTER * np.eye(len(size))
        inverse: Floats = np.linalg.inv(scaled) / np.outer(size, size)
        return inverse

    def distance(self, values: Floats) -> float:
        """Return the square of the distance of coefficients from the mean, in deviations."""
        return float((values - self.mean) @ self.precision @ (values - self.mean))

    def augment(self, mean: float, variance: float, count: int = 1) -> "Gaussian":
        """Add independent coefficients of one mean and variance."""
        means = np.append(self.mean, np.full(count, mean))
        grown = Gaussian(means, block_diag(self.covariance, variance * np.eye(count)))
        # Known without another inversion: that of hundreds of coefficients costs more than all the rest.
        vars(grown)["precision"] = block_diag(self.precision, np.eye(count) / variance)
        return grown

    def with_first(self, first: "Gaussian") -> "Gaussian":
        """Replace the distribution of the first coefficients by an independent one."""
        count = len(first.mean)
        mean, covariance = self.mean.copy(), self.covariance.copy()
        covariance[:count, count:], covariance[count:, :count] = 0.0, 0.0
        mean[:count], covariance[:count, :count] = first.mean, first.covariance
        return Gaussian(mean, covariance)

    def inflate(self, spreads: Floats) -> "Gaussian":
        """Add independent variation of each coefficient with standard deviations, shape (columns,)."""
        return Gaussian(self.mean, self.covariance + np.diag(spreads**2))

    def posterior(self, data: Total, fraction: float) -> "Gaussian":
        """Condition on products.

        Args:
            data: Sum of products.
            fraction: Effective sample fraction: independent samples over samples.
        """
        normal = fraction * data.matrix + self.precision
        factor = Factor.of(normal)
        right = fraction * data.vector + self.precision @ self.mean
        return Gaussian(factor.solve(right), _symmetric(factor.solve(np.eye(len(right)))))


NOTHING = Gaussian(np.zeros(0), np.zeros((0, 0)))
"""A distribution of no coefficients, to be augmented."""


@dataclass(frozen=True)
class Marginal:
    """Normal equations with the common coefficients marginalised: what extra coefficients could gain.

    Args:
        matrix: M, information on extra coefficients, shape (columns, columns).
        vector: b, shape (columns,).
        cost: Weighted squares that remain without extra coefficients, the prior's included.
        count: Effective number of samples.
        shift: Most probable common coefficients, without extra ones, less the prior mean, shape (columns,).
        covariance: Of the common coefficients, shape (columns, columns).
    """

    matrix: Floats
    vector: Floats
    cost: float
    count: float
    shift: Floats
    covariance: Floats

    @classmethod
    def of(cls, prior: Gaussian, data: Total, fraction: float) -> "Marginal":
        """Marginalise the common coefficients over what was seen."""
        gram, (right, sum_of_squares) = fraction * data.matrix, _surprise(prior, data, fraction)
        solved = Factor.of(gram + prior.precision).solve(np.column_stack([gram, right]))
        matrix = gram - gram @ solved[:, :-1]
        vector = right - gram @ solved[:, -1]
        cost = sum_of_squares - float(right @ solved[:, -1])
        covariance = _symmetric(prior.covariance - solved[:, :-1] @ prior.covariance)
        count = fraction * data.count
        return cls(_symmetric(matrix), vector, cost, count, solved[:, -1], covariance)

    @staticmethod
    def cost_of(prior: Gaussian, data: Total, fraction: float) -> float:
        """Return the cost alone."""
        right, sum_of_squares = _surprise(prior, data, fraction)
        factor = Factor.of(fraction * data.matrix + prior.precision)
        return sum_of_squares - float(right @ factor.solve(right))

    def gain(self, columns: Sequence[int]) -> tuple[float, Floats]:
        """Return how much some extra coefficients lower the cost, and their values."""
        submatrix = np.ix_(list(columns), list(columns))
        block = self.matrix[submatrix]
        size = np.sqrt(np.maximum(np.diag(block), 1e-300))
        scaled = block / np.outer(size, size) + 1e-6 * np.eye(len(size))
        values = np.linalg.solve(scaled, self.vector[list(columns)] / size) / size
        return float(self.vector[list(columns)] @ values), values

    def usual_gain(self, columns: Sequence[int]) -> float:
        """Return how much common coefficients lower the cost by leaving their prior mean."""
        block, shift = self.covariance[np.ix_(columns, columns)], self.shift[list(columns)]
        return float(shift @ Factor.of(block).solve(shift))

    def null_draws(self, rng: np.random.Generator, draws: int, first: int) -> Floats:
        """Draw what b would be where nothing is missing: normal of covariance M.

        Args:
            rng: Of the draws.
            draws: Number of draws.
            first: First column that is drawn; all must be of one order of size.

        Returns:
            Shape (draws, columns from the first).
        """
        block = self.matrix[first:, first:]
        diagonal = np.diag(block)
        visible = diagonal > 1e-9 * diagonal.max(initial=0.0)
        size = np.where(visible, np.sqrt(np.maximum(diagonal, 1e-300)), 1.0)
        scaled = np.where(np.outer(visible, visible), block / np.outer(size, size), 0.0)
        values, vectors = np.linalg.eigh(_symmetric(scaled))
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        drawn: Floats = (rng.normal(size=(draws, len(size))) @ root.T) * size
        return drawn


def _surprise(prior: Gaussian, data: Total, fraction: float) -> tuple[Floats, float]:
    """Return the products of the columns with what the prior mean leaves, and its weighted squares."""
    right = fraction * (data.vector - data.matrix @ prior.mean)
    sum_of_squares = (
        data.sum_of_squares - 2.0 * prior.mean @ data.vector + prior.mean @ data.matrix @ prior.mean
    )
    return right, fraction * float(sum_of_squares)


def _symmetric(matrix: Floats) -> Floats:
    out: Floats = 0.5 * (matrix + matrix.T)
    return out
