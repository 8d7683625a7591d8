"""The quadratic program of one step: its build and, apart from it, its solution."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numba import njit
from numpy.typing import NDArray
from proxsuite import proxqp

from softarm.estimator.arrays import Floats
from softarm.estimator.inverse.limits import InputBounds
from softarm.estimator.inverse.objectives import WeightedRows
from softarm.estimator.small_matrices import factorise, solve_factored

DAMPING = 1e-12
"""Share of the largest curvature added to the diagonal, for directions that nothing fixes."""
TOLERANCE = 1e-10
"""Largest absolute residual of the optimality conditions."""
MOST_ITERATIONS = 200
"""ProxQP needs about twenty. Where rounding keeps it above the tolerance, more of them gain nothing."""


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
    rows: Sequence[WeightedRows], limits: InputBounds, vector: Floats, scale: Floats, radius: float
) -> QuadraticProgram:
    """Gather the objectives' rows: H = S sum(J^T R^-1 J) S, g = S sum(J^T R^-1 r), S = diag(scale).

    Args:
        rows: Rows of all objectives at the iterate.
        limits: Bounds of the inputs.
        vector: The iterate, shape (inputs,).
        scale: Typical change of each input, shape (inputs,).
        radius: Largest change of a free input, in units of its scale (trust region).
    """
    size = len(vector)
    program = QuadraticProgram(np.empty((size, size)), np.empty(size), np.empty(size), np.empty(size))
    _fill(
        sum_of(row.normal for row in rows), sum_of(row.gradient for row in rows), limits.lower, limits.upper,
        vector, scale, radius, DAMPING, program.hessian, program.gradient, program.lower, program.upper,
    )  # fmt: skip
    return program


def sum_of(terms: Iterable[Floats]) -> Floats:
    """Add arrays of one shape, of which there is at least one."""
    return reduce(np.add, terms)


@njit(cache=True, nogil=True)
def _fill(
    normal: Floats,
    right: Floats,
    smallest: Floats,
    largest: Floats,
    vector: Floats,
    scale: Floats,
    radius: float,
    damping: float,
    hessian: Floats,
    gradient: Floats,
    lower: Floats,
    upper: Floats,
) -> None:
    """Fill the program from J^T R^-1 J and J^T R^-1 r of all rows and the bounds of the inputs."""
    size, curvature = len(vector), 1.0
    for r in range(size):
        for c in range(size):
            hessian[r, c] = normal[r, c] * scale[r] * scale[c]
        curvature = max(curvature, hessian[r, r])
    for r in range(size):
        hessian[r, r] += damping * curvature
        gradient[r] = right[r] * scale[r]
        lower[r] = (smallest[r] - vector[r]) / scale[r]
        upper[r] = (largest[r] - vector[r]) / scale[r]
        if smallest[r] != largest[r]:
            # A bound that the iterate violates must stay within reach, however small the trust region.
            lower[r] = max(lower[r], min(-radius, upper[r]))
            upper[r] = min(upper[r], max(radius, lower[r]))


def solve_program(program: QuadraticProgram) -> Floats:
    """Solve a program: by one linear system where no bound binds, else with ProxQP.

    z has shape (inputs,); it is NaN where the program has numbers that are not finite.

    A convex program whose optimum without its bounds lies inside them has that optimum; only otherwise is
    the augmented Lagrangian method needed (Bambade et al., ProxQP, RSS 2022).
    """
    value = np.empty_like(program.gradient)
    if _unbounded(program.hessian, program.gradient, program.lower, program.upper, value):
        return value
    if not (np.isfinite(program.hessian).all() and np.isfinite(program.gradient).all()):
        # ProxQP would iterate on them for half a minute.
        return np.full_like(value, np.nan)
    return _proxqp(program, program.lower == program.upper)


@njit(cache=True, nogil=True)
def _unbounded(hessian: Floats, gradient: Floats, lower: Floats, upper: Floats, value: Floats) -> bool:
    """Fill the optimum over what is not held; return whether it lies within the bounds."""
    free = np.flatnonzero(lower != upper)
    inner, factor, right = np.empty((len(free), len(free))), np.empty((len(free), len(free))), gradient[free]
    # Held inputs keep their value, and what it causes goes to the right-hand side.
    value[:] = lower
    for r in range(len(free)):
        for c in range(len(value)):
            if lower[c] == upper[c]:
                right[r] -= hessian[free[r], c] * lower[c]
        for c in range(len(free)):
            inner[r, c] = hessian[free[r], free[c]]
    if not factorise(inner, factor):
        return False
    solve_factored(factor, right)
    for r in range(len(free)):
        value[free[r]] = right[r]
        if not lower[free[r]] <= right[r] <= upper[free[r]]:
            return False
    return True


def _proxqp(program: QuadraticProgram, held: NDArray[np.bool_]) -> Floats:
    size = len(program.gradient)
    equalities = np.eye(size)[held]
    problem = proxqp.dense.QP(size, len(equalities), int(size - len(equalities)))
    problem.settings.eps_abs = TOLERANCE
    problem.settings.eps_rel = 0.0
    problem.settings.max_iter = problem.settings.max_iter_in = MOST_ITERATIONS
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
