"""Factor of the tangent stiffness: the symbolic analysis is kept, and unsymmetric tangents are refined."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.fem.linalg.blas import Blas, load_blas
from softarm.estimator.fem.linalg.cholesky_kernel import (
    factorise_multifrontal,
    multiply_blocks,
    solve_multifrontal,
)
from softarm.estimator.fem.linalg.pardiso import PardisoPlan
from softarm.estimator.fem.linalg.pattern import Pattern, Tangent
from softarm.estimator.fem.linalg.symbolic import SymbolicFactorisation

REFINEMENT = 1e-10
"""Residual over the right-hand side at which refinement ends."""
REFINEMENTS = 30


class SymmetricFactor(Protocol):
    """A factor of a symmetric positive definite matrix; never changes."""

    def solve(self, right: Floats) -> Floats:
        """Solve for right-hand sides in elimination order, shapes (size,) or (right-hand sides, size)."""


@dataclass(frozen=True)
class CholeskyPlan:
    """A multifrontal Cholesky factorisation, its analysis shared by all factors of a pattern."""

    symbolic: SymbolicFactorisation
    blas: Blas

    @classmethod
    def of(cls, symbolic: SymbolicFactorisation) -> "CholeskyPlan":
        """Bind an analysis to scipy's BLAS."""
        return cls(symbolic, load_blas())

    def factorise(self, values: Floats) -> "CholeskyFactor | None":
        """Factor a matrix of blocks, shape (slots, size, size); None where it is not positive definite."""
        s, panels = self.symbolic, np.empty(self.symbolic.panel[-1])
        definite = factorise_multifrontal(
            self.blas.addresses, self.blas.letters, values, s.pivots, s.borders, s.children, s.child_start,
            s.relative, s.relative_start, s.slot, s.slot_start, s.slot_row, s.slot_column, s.panel,
            s.update, panels, np.empty(s.work),
        )  # fmt: skip
        return CholeskyFactor(self, panels) if definite else None


@dataclass(frozen=True)
class CholeskyFactor:
    """A multifrontal factor."""

    plan: CholeskyPlan
    panels: Floats

    def solve(self, right: Floats) -> Floats:
        """Solve for right-hand sides in elimination order, shapes (size,) or (right-hand sides, size)."""
        s = self.plan.symbolic
        solution = np.array(np.atleast_2d(right), dtype=float, order="C")
        solve_multifrontal(
            self.plan.blas.addresses, self.plan.blas.letters, s.size, s.pivots, s.borders, s.rows,
            s.row_start, s.panel, self.panels, solution, np.empty(s.widest * len(solution)),
        )  # fmt: skip
        return solution.reshape(np.shape(right))


@dataclass(frozen=True)
class FactorPlan:
    """How the tangents of a pattern are factored.

    Args:
        pattern: Block pattern, free nodes in elimination order.
        backend: PARDISO where it is installed, else the multifrontal factorisation of this package.
    """

    pattern: Pattern
    backend: CholeskyPlan | PardisoPlan

    @classmethod
    def of(cls, pattern: Pattern, symbolic: SymbolicFactorisation) -> "FactorPlan":
        """Choose the fastest backend that is installed."""
        return cls(pattern, PardisoPlan.of(pattern) or CholeskyPlan.of(symbolic))

    def factorise(self, tangent: Tangent) -> "StiffnessFactor | None":
        """Factor the symmetric part of a tangent; None where that part is not positive definite."""
        values = tangent.values if tangent.symmetric else 0.5 * (tangent.values + tangent.mirror)
        factor = self.backend.factorise(values)
        if factor is None:
            return None
        return StiffnessFactor(self.pattern, factor, None if tangent.symmetric else tangent)


@dataclass(frozen=True)
class StiffnessFactor:
    """Solves with a factored tangent; never changes.

    Args:
        pattern: Block pattern.
        symmetric: Factor of the symmetric part.
        exact: The tangent itself where it is not symmetric; solves are then refined against it.
    """

    pattern: Pattern
    symmetric: SymmetricFactor
    exact: Tangent | None

    def solve(self, right: Floats) -> Floats:
        """Solve K x = right, shapes (3 free,) or (right-hand sides, 3 free)."""
        return self._refined(right, transposed=False)

    def solve_roughly(self, right: Floats) -> Floats:
        """Solve with the symmetric part alone, which is exact for a symmetric tangent."""
        return self.symmetric.solve(right)

    def solve_transposed(self, right: Floats) -> Floats:
        """Solve K^T x = right, shapes (3 free,) or (right-hand sides, 3 free)."""
        return self._refined(right, transposed=True)

    def _refined(self, right: Floats, *, transposed: bool) -> Floats:
        solution = self.symmetric.solve(right)
        if self.exact is None:
            return solution
        size, last = np.linalg.norm(right), np.inf
        for _ in range(REFINEMENTS):
            residual = right - self._multiply(self.exact, solution, transposed=transposed)
            norm = float(np.linalg.norm(residual))
            # Near enough, or the unsymmetric part is so large that the iteration does not contract.
            if not REFINEMENT * size < norm < 0.9 * last:
                break
            solution, last = solution + self.symmetric.solve(residual), norm
        return solution

    def _multiply(self, tangent: Tangent, vectors: Floats, *, transposed: bool) -> Floats:
        stacked = np.ascontiguousarray(np.atleast_2d(vectors))
        product = np.empty_like(stacked)
        multiply_blocks(
            tangent.values, tangent.mirror, self.pattern.row, self.pattern.column_start, stacked, product,
            transposed,
        )  # fmt: skip
        return product.reshape(np.shape(vectors))
