"""The quadratic program of one step: its build and, apart from it, its solution."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from proxsuite import proxqp

from softarm.estimator.arrays import Floats
from softarm.estimator.inverse.limits import InputBounds
from softarm.estimator.inverse.objectives import WeightedRows

DAMPING = 1e-12
"""Share of the largest curvature added to the diagonal, for directions that nothing fixes."""
TOLERANCE = 1e-10
"""Largest absolute residual of the optimality conditions."""


@dataclass(frozen=True)
class QuadraticProgram:
    """Minimise z^T H z / 2 - g^T z subject to lower <= z <= upper, z = du / scale.

    Args:
        hessian: H, shape (inputs, inputs).
        gradient: g, shape (inputs,).
        lower: Shape (inputs,).
        upper: Shape (inputs,); equal to ``lower`` where held.
    """

    hessian: Floats
    gradient: Floats
    lower: Floats
    upper: Floats


def build_program(
    rows: Sequence[WeightedRows],
    limits: InputBounds,
    vector: Floats,
    scale: Floats,
    radius: float,
) -> QuadraticProgram:
    """Gather the objectives' rows: H = S sum(J^T R^-1 J) S, g = S sum(J^T R^-1 r), S = diag(scale).

    Args:
        rows: Rows of all objectives at the iterate.
        limits: Bounds of the inputs.
        vector: The iterate, shape (inputs,).
        scale: Typical change of each input, shape (inputs,).
        radius: Largest change of a free input, in units of its scale (trust region).

    Returns:
        The program for the change of the inputs.
    """
    size = len(vector)
    hessian, gradient = np.zeros((size, size)), np.zeros(size)
    for row in rows:
        weighted = row.jacobian.T @ row.information
        hessian += weighted @ row.jacobian
        gradient += weighted @ row.innovation
    hessian *= scale[:, None] * scale
    hessian[np.diag_indices(size)] += DAMPING * max(float(np.diag(hessian).max(initial=0.0)), 1.0)
    lower = (limits.lower - vector) / scale
    upper = (limits.upper - vector) / scale
    free = ~limits.held
    # A bound that the iterate violates must stay within reach, however small the trust region.
    lower[free] = np.maximum(lower[free], np.minimum(-radius, upper[free]))
    upper[free] = np.minimum(upper[free], np.maximum(radius, lower[free]))
    return QuadraticProgram(hessian, gradient * scale, lower, upper)


def solve_program(program: QuadraticProgram) -> Floats:
    """Solve a program: by one linear system where no bound binds, else with ProxQP.

    A convex program whose optimum without its bounds lies inside them has that optimum; only otherwise is
    the augmented Lagrangian method needed (Bambade et al., ProxQP, RSS 2022).

    Returns:
        z, shape (inputs,).
    """
    held = program.lower == program.upper
    value = np.where(held, program.lower, 0.0)
    free = ~held
    if free.any():
        inner = program.hessian[free][:, free]
        value[free] = np.linalg.solve(
            inner, program.gradient[free] - program.hessian[free][:, held] @ value[held]
        )
    if ((program.lower <= value) & (value <= program.upper)).all():
        return value
    return _proxqp(program, held)


def _proxqp(program: QuadraticProgram, held: NDArray[np.bool_]) -> Floats:
    size = len(program.gradient)
    equalities = np.eye(size)[held]
    problem = proxqp.dense.QP(size, len(equalities), int(size - len(equalities)))
    problem.settings.eps_abs = TOLERANCE
    problem.settings.eps_rel = 0.0
    problem.settings.verbose = False
    free = ~held
    problem.init(
        program.hessian,
        -program.gradient,
        equalities,
        program.lower[held],
        np.eye(size)[free],
        program.lower[free],
        program.upper[free],
    )
    problem.solve()
    # The solver meets bounds to its tolerance only; what leaves here never exceeds a pressure limit.
    value: Floats = np.minimum(np.maximum(np.array(problem.results.x), program.lower), program.upper)
    return value
