"""Factor of the tangent stiffness: multifrontal, by nested dissection, the symbolic analysis kept."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.fem.linalg.blas import Blas, load_blas
from softarm.estimator.fem.linalg.cholesky_kernel import factor_fronts, multiply_blocks, solve_fronts
from softarm.estimator.fem.linalg.pattern import Pattern, Tangent
from softarm.estimator.fem.linalg.symbolic import SymbolicFactorisation
from softarm.estimator.mesh import Floats

REFINEMENT = 1e-10
REFINEMENTS = 30


@dataclass(frozen=True)
class FactorPlan:
    """The symbolic analysis of a pattern, shared by all its factors.

    Args:
        pattern: Block pattern, free nodes in elimination order.
        symbolic: Dense fronts.
        blas: Routines the kernels call.
    """

    pattern: Pattern
    symbolic: SymbolicFactorisation
    blas: Blas

    @classmethod
    def of(cls, pattern: Pattern, symbolic: SymbolicFactorisation) -> "FactorPlan":
        """Bind an analysis to scipy's BLAS."""
        return cls(pattern, symbolic, load_blas())

    def factorise(self, tangent: Tangent) -> "StiffnessFactor | None":
        """Factor the symmetric part of a tangent by Cholesky.

        Returns:
            The factor; None where that part is not positive definite.
        """
        values = tangent.values if tangent.symmetric else 0.5 * (tangent.values + tangent.mirror)
        f, panels = self.symbolic, np.empty(self.symbolic.panel[-1])
        definite = factor_fronts(
            self.blas.addresses, self.blas.letters, values, f.pivots, f.borders, f.children, f.child_start,
            f.relative, f.relative_start, f.slot, f.slot_start, f.slot_row, f.slot_column, f.panel,
            f.update, panels, np.empty(f.work),
        )  # fmt: skip
        return StiffnessFactor(self, panels, None if tangent.symmetric else tangent) if definite else None


@dataclass(frozen=True)
class StiffnessFactor:
    """Solves with a factored tangent; never changes.

    Args:
        plan: The analysis it follows.
        panels: Numbers of the factor.
        exact: The tangent itself where it is not symmetric; solves are then refined against it.
    """

    plan: FactorPlan
    panels: Floats
    exact: Tangent | None

    def solve(self, right: Floats) -> Floats:
        """Solve K x = right, shapes (3 free,) or (right-hand sides, 3 free)."""
        return self._refined(right, transposed=False)

    def solve_roughly(self, right: Floats) -> Floats:
        """Solve with the symmetric part alone, which is exact for a symmetric tangent."""
        return self._solve(right)

    def solve_transposed(self, right: Floats) -> Floats:
        """Solve K^T x = right, shapes (3 free,) or (right-hand sides, 3 free)."""
        return self._refined(right, transposed=True)

    def _refined(self, right: Floats, *, transposed: bool) -> Floats:
        solution = self._solve(right)
        if self.exact is None:
            return solution
        size, last = np.linalg.norm(right), np.inf
        for _ in range(REFINEMENTS):
            residual = right - self._multiply(solution, transposed=transposed)
            norm = float(np.linalg.norm(residual))
            if not REFINEMENT * size < norm < 0.9 * last:
                break
            solution, last = solution + self._solve(residual), norm
        return solution

    def _solve(self, right: Floats) -> Floats:
        """Solve with the symmetric part."""
        f = self.plan.symbolic
        solution = np.array(np.atleast_2d(right), dtype=float, order="C")
        solve_fronts(
            self.plan.blas.addresses, self.plan.blas.letters, f.size, f.pivots, f.borders, f.rows,
            f.row_start, f.panel, self.panels, solution, np.empty(f.widest * len(solution)),
        )  # fmt: skip
        return solution.reshape(np.shape(right))

    def _multiply(self, vectors: Floats, *, transposed: bool) -> Floats:
        assert self.exact is not None
        pattern, stacked = self.plan.pattern, np.ascontiguousarray(np.atleast_2d(vectors))
        product = np.empty_like(stacked)
        multiply_blocks(
            self.exact.values,
            self.exact.mirror,
            pattern.row,
            pattern.column_start,
            stacked,
            product,
            transposed,
        )
        return product.reshape(np.shape(vectors))
