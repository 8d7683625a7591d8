"""Factor of the tangent stiffness."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import SuperLU, splu

from estimator.fem.body import Tangent
from estimator.fem.pattern import Pattern
from estimator.mesh import Floats


@dataclass(frozen=True)
class StiffnessFactor:
    """Solves with a factored tangent; never changes.

    Args:
        factor: SuperLU's factor.
        negative_pivots: Number of unstable directions of a symmetric tangent.
    """

    factor: SuperLU
    negative_pivots: int

    def solve(self, right: Floats) -> Floats:
        """Solve K x = right, shapes (3 free,) or (right-hand sides, 3 free)."""
        return np.asarray(self.factor.solve(np.ascontiguousarray(right.T)).T)

    def solve_transposed(self, right: Floats) -> Floats:
        """Solve K^T x = right, shapes (3 free,) or (right-hand sides, 3 free)."""
        return np.asarray(self.factor.solve(np.ascontiguousarray(right.T), trans="T").T)


def factorise(pattern: Pattern, tangent: Tangent) -> StiffnessFactor | None:
    """Factor a tangent; None when it is singular."""
    matrix = pattern.matrix(tangent.values, tangent.mirror)
    try:
        factor = splu(
            matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
    except RuntimeError:
        return None
    return StiffnessFactor(factor, int((factor.U.diagonal() < 0.0).sum()))
