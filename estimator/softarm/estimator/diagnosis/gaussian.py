"""The Gaussian distribution of the coefficients that are common to all recordings."""

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
        scaled = symmetric(matrix / np.outer(size, size))
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
        return Gaussian(factor.solve(right), symmetric(factor.solve(np.eye(len(right)))))


NOTHING = Gaussian(np.zeros(0), np.zeros((0, 0)))
"""A distribution of no coefficients, to be augmented."""


def symmetric(matrix: Floats) -> Floats:
    """Return the symmetric part of a matrix."""
    out: Floats = 0.5 * (matrix + matrix.T)
    return out
