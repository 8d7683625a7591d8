"""Some stretches with the coefficients that are common to all recordings marginalised.

Residuals follow r = C (c + d) + X x + e: C are the columns of calibration and library, c what holds for
every recording (Gaussian, with mean m and precision P), d the extra coefficients of a hypothesis, X new
columns, e noise with weights W and an effective sample fraction f. With A = f C^T W C + P, factorised once
for all that is tried, H = f C^T W X and G = f C^T W C, the normal equations are

    of new columns      f X^T W X - H^T A^-1 H   and   f X^T W (r - C m) - H^T A^-1 f C^T W (r - C m),
    of the common ones          G - G A^-1 G     and   (I - G A^-1) f C^T W (r - C m).

The gain of a few of them, of matrix M and vector b, is b^T M^-1 b.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.gaussian import Factor, Gaussian, symmetric
from softarm.estimator.diagnosis.normal_equations import NewColumns, NormalEquations, Total


@dataclass(frozen=True)
class Combinations:
    """Combinations X N + C K of new columns X and the common ones.

    Args:
        new: N, shape (new, combinations).
        common: K, shape (columns, combinations).
    """

    new: Floats
    common: Floats


@dataclass(frozen=True)
class Marginaliser:
    """Some stretches, ready to marginalise the common coefficients beside new columns.

    Args:
        data: Sum of their normal equations.
        prior: Of the common coefficients.
        fraction: Effective sample fraction: independent samples over samples.
        factor: Of A.
    """

    data: Total
    prior: Gaussian
    fraction: float
    factor: Factor

    @classmethod
    def of(cls, data: Total, prior: Gaussian, fraction: float) -> "Marginaliser":
        """Factorise A."""
        return cls(data, prior, fraction, Factor.of(fraction * data.matrix + prior.precision))

    def renewed(self, parts: Sequence[NormalEquations]) -> "Marginaliser":
        """Return that of the same stretches with another residual."""
        vector = np.sum([part.vector for part in parts], axis=0)
        sum_of_squares = sum(part.sum_of_squares for part in parts)
        return replace(self, data=replace(self.data, vector=vector, sum_of_squares=sum_of_squares))

    @cached_property
    def right(self) -> Floats:
        """Products of the columns with what the prior mean leaves, f C^T W (r - C m), shape (columns,)."""
        right: Floats = self.fraction * (self.data.vector - self.data.matrix @ self.prior.mean)
        return right

    @cached_property
    def mean(self) -> Floats:
        """Most probable common coefficients without new columns, shape (columns,)."""
        return self.prior.mean + self.factor.solve(self.right)

    @cached_property
    def cost(self) -> float:
        """Weighted squares that remain without new columns, the prior's included."""
        mean = self.prior.mean
        squares = self.data.sum_of_squares - mean @ (self.data.vector + self.right / self.fraction)
        return float(self.fraction * squares - self.right @ self.factor.solve(self.right))

    def squares(self, new: NewColumns, common: Floats, sizes: Floats) -> float:
        """Return the weighted squares that common coefficients and those of new columns leave."""
        new_squares = sizes @ (new.matrix @ sizes + 2.0 * (common @ new.cross - new.vector))
        return self.common_squares(common) + self.fraction * float(new_squares)

    def common_squares(self, common: Floats) -> float:
        """Return the weighted squares that common coefficients leave without new columns."""
        data = self.data
        squares = data.sum_of_squares + common @ (data.matrix @ common - 2.0 * data.vector)
        return self.fraction * float(squares)

    def combined(self, new: NewColumns, wanted: Combinations) -> NewColumns:
        """Return the products of combinations of new columns and the common ones."""
        common = self.data.matrix @ wanted.common
        mixed = wanted.new.T @ (new.cross.T @ wanted.common)
        return NewColumns(
            new.cross @ wanted.new + common,
            wanted.new.T @ new.matrix @ wanted.new + mixed + mixed.T + wanted.common.T @ common,
            wanted.new.T @ new.vector + wanted.common.T @ self.data.vector,
        )

    def marginal(self, new: NewColumns) -> Total:
        """Return the normal equations of new columns, of effective samples."""
        cross = self.fraction * new.cross
        solved = self.factor.solve(cross)
        matrix = symmetric(self.fraction * new.matrix - cross.T @ solved)
        vector = self.fraction * new.vector - cross.T @ self.prior.mean - solved.T @ self.right
        return Total(self.fraction * self.data.count, matrix, vector, self.cost)


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
    def of(cls, seen: Marginaliser) -> "Marginal":
        """Take the common columns themselves as those of extra coefficients."""
        gram, prior = seen.fraction * seen.data.matrix, seen.prior
        solved, shift = seen.factor.solve(gram), seen.factor.solve(seen.right)
        return cls(
            symmetric(gram - gram @ solved),
            seen.right - gram @ shift,
            seen.cost,
            seen.fraction * seen.data.count,
            shift,
            symmetric(prior.covariance - solved @ prior.covariance),
        )

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


def null_draws(information: Floats, rng: np.random.Generator, draws: int) -> Floats:
    """Draw what the vector of normal equations would be where nothing is missing: normal of their matrix.

    Args:
        information: The matrix, whose columns must be of one order of size, shape (columns, columns).
        rng: Of the draws.
        draws: Number of draws.

    Returns:
        Shape (draws, columns).
    """
    diagonal = np.diag(information)
    visible = diagonal > 1e-9 * diagonal.max(initial=0.0)
    size = np.where(visible, np.sqrt(np.maximum(diagonal, 1e-300)), 1.0)
    scaled = np.where(np.outer(visible, visible), information / np.outer(size, size), 0.0)
    values, vectors = np.linalg.eigh(symmetric(scaled))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    drawn: Floats = (rng.normal(size=(draws, len(size))) @ root.T) * size
    return drawn


def cost_of(prior: Gaussian, data: Total, fraction: float) -> float:
    """Return the weighted squares that common coefficients leave; see ``Marginaliser.cost``."""
    return Marginaliser.of(data, prior, fraction).cost
