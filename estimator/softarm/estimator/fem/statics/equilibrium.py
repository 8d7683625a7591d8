"""Newton's iteration to an equilibrium nearby, and descent to one far away."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.fem.assembly import AssembledForces, Body
from softarm.estimator.fem.linalg.cholesky import StiffnessFactor
from softarm.estimator.fem.linalg.pattern import Tangent
from softarm.estimator.fem.statics.solution import Solution, SolveStatus
from softarm.estimator.model import Inputs

GROWTH_LIMIT = 1e6
"""Residual over the least one so far, above which an iteration is given up."""
POOR = 0.7
"""Contraction of the residual that counts as poor; three of them in a row end an iteration."""
SADDLE = 1e-5
"""Residual below which an equilibrium is near; the solve leaves it when it is unstable."""
TILT = 0.1
"""Largest displacement of a node when leaving it, over that of a step."""
SHIFTS = 10.0 ** np.arange(-8, 4)
"""Multiples of the mean diagonal that are tried to make a tangent positive definite."""


@dataclass(frozen=True)
class Settings:
    """Limits of the iteration.

    Args:
        tolerance: Out-of-balance force over the applied force at which it is converged.
        iterations: Linear solves allowed in one load step.
        longest_move: Largest displacement of a node in one linear step, over the body's size.
        smallest_step: Fraction of the change of load at which halving ends.
        total_iterations: Linear solves allowed in one call, reckoned after each load step.
        descent: Linear solves allowed to cross a snap-through; with none, the load path ends there.
    """

    tolerance: float = 1e-9
    iterations: int = 12
    longest_move: float = 0.1
    smallest_step: float = 1e-4
    total_iterations: int = 500
    descent: int = 60


@dataclass(frozen=True)
class Balance:
    """Forces at a configuration under given inputs.

    Args:
        evaluation: Internal forces, volumes and tangent.
        residual: Applied less internal force on the free nodes [N], shape (3 free,).
        load_vectors: Nodal forces per unit of each load, shape (loads, nodes, 3).
        norm: Norm of the residual over that of the applied forces.
    """

    evaluation: AssembledForces
    residual: Floats
    load_vectors: Floats
    norm: float


Balancer = Callable[[Floats, Inputs, bool], Balance]


@dataclass(frozen=True)
class Corrected:
    """Where Newton's iteration ended.

    Args:
        solution: Displacement and how it ended.
        balance: Forces there, tangent included.
        factor: Factor of the tangent there; None where it is not positive definite.
    """

    solution: Solution[Floats]
    balance: Balance
    factor: StiffnessFactor | None


def stable_factor(
    body: Body, balancer: Balancer, displacement: Floats, inputs: Inputs
) -> tuple[Balance, StiffnessFactor | None]:
    """Evaluate and factor the tangent, or the nearest stand-in that is positive definite.

    The stand-in is the tangent with the least shift of its diagonal, among powers of ten, that makes it
    positive definite. The balance is that of the exact forces in every case.
    """
    balance = balancer(displacement, inputs, True)
    if not balance.evaluation.valid:
        return balance, None
    factor = exact_factor(body, balance)
    for shift in SHIFTS:
        if factor is not None:
            break
        factor = body.plan.factorise(_shifted(body, balance, shift))
    return balance, factor


def exact_factor(body: Body, balance: Balance) -> StiffnessFactor | None:
    """Factor the tangent of a balance; None where it is not positive definite or was not assembled."""
    tangent = balance.evaluation.tangent
    return None if tangent is None else body.plan.factorise(tangent)


def _shifted(body: Body, balance: Balance, shift: float) -> Tangent:
    """Add a multiple of the mean diagonal to a tangent's diagonal."""
    assert balance.evaluation.tangent is not None
    values, mirror = balance.evaluation.tangent.values.copy(), balance.evaluation.tangent.mirror.copy()
    diagonal = body.pattern.column_start[:-1]
    mean = np.abs(np.trace(values[diagonal], axis1=1, axis2=2)).mean() / 3.0
    for blocks in (values, mirror):
        blocks[diagonal] += shift * mean * np.eye(3)
    return Tangent(values, values if balance.evaluation.tangent.symmetric else mirror)


def longest_move(displacement: Floats) -> float:
    """Compute the largest displacement of a node [m], from shape (nodes, 3)."""
    return float(np.sqrt((displacement**2).sum(axis=1).max()))


def size_of(body: Body) -> float:
    """Compute the longest side of the body's box at rest [m]."""
    return float(np.ptp(body.points, axis=0).max())


def correct(body: Body, balancer: Balancer, start: Floats, inputs: Inputs, settings: Settings) -> Corrected:
    """Iterate by Newton's method from near an equilibrium.

    Args:
        body: The body.
        balancer: Evaluates forces: (displacement, inputs, tangent, load stiffness) to ``Balance``.
        start: First displacement [m], shape (nodes, 3).
        inputs: Pressures, loads, gravity.
        settings: Limits.

    Returns:
        Where it ended; ``UNSTABLE`` when the tangent there is not positive definite.
    """
    displacement, least, last, poor = start, np.inf, np.inf, 0
    reach = settings.longest_move * size_of(body)
    # One evaluation more than steps, since the last step is judged as well.
    for iteration in range(settings.iterations + 1):
        balance = balancer(displacement, inputs, True)
        factor = exact_factor(body, balance) if balance.evaluation.valid else None
        status = _verdict(balance, factor, settings)
        poor = poor + 1 if balance.norm > POOR * last else 0
        least, last = min(least, balance.norm), balance.norm
        if status is None and (poor >= 3 or last > GROWTH_LIMIT * least):
            status = SolveStatus.STALLED
        if status is None and iteration == settings.iterations:
            status = SolveStatus.ITERATIONS
        if status is not None:
            return Corrected(Solution(displacement, status, iteration, balance.norm), balance, factor)
        assert factor is not None
        step = body.pattern.scatter(factor.solve(balance.residual))
        displacement = take_step(body, balancer, displacement, step, inputs, reach)
    raise AssertionError("the loop returns")


def _verdict(balance: Balance, factor: StiffnessFactor | None, settings: Settings) -> SolveStatus | None:
    """Decide whether an iteration is over; None to go on."""
    if not balance.evaluation.valid:
        return SolveStatus.INVERTED
    if factor is None:
        return SolveStatus.UNSTABLE
    return SolveStatus.CONVERGED if balance.norm <= settings.tolerance else None


def take_step(
    body: Body, balancer: Balancer, displacement: Floats, step: Floats, inputs: Inputs, reach: float
) -> Floats:
    """Move by a step, shortened to ``reach`` [m] and halved while it inverts an element (8 times at most).

    The step bends the body instead of moving its nodes straight on, which would stretch it.
    """
    longest = longest_move(step)
    if not np.isfinite(longest):
        return displacement
    step = step * min(1.0, reach / max(longest, 1e-300))
    deformation = body.rotation_strain.deformation(displacement)
    # Where no halving helps the shortest step is taken: the next evaluation then shows that it is invalid.
    for halving in range(8):
        after = body.rotation_strain.moved(displacement, deformation, step * 0.5**halving)
        if balancer(after, inputs, False).evaluation.valid:
            break
    return after


def _softest(factor: StiffnessFactor, residual: Floats) -> Floats:
    """Find the mode of least stiffness by inverse iteration, with the sign of the residual."""
    # Random, so as not to be orthogonal to the mode; seeded, so that an arm snaps alike every time.
    mode = np.random.default_rng(0).standard_normal(residual.shape)
    # A rough direction is enough to leave a saddle by.
    for _ in range(4):
        mode = factor.solve_roughly(mode / np.linalg.norm(mode))
    return mode if mode @ residual >= 0.0 else -mode


def descend(body: Body, balancer: Balancer, start: Floats, inputs: Inputs, settings: Settings) -> Corrected:
    """Descend in potential energy to a stable equilibrium, which may be far away: across a snap-through.

    Every step is one of descent, because the shifted tangent is positive definite. It is halved while the
    force along it is reversed by more than half, so that the energy falls. An unstable equilibrium is left
    along the softest mode.
    """
    displacement, reach = start, settings.longest_move * size_of(body)
    for iteration in range(settings.descent):
        balance, factor = stable_factor(body, balancer, displacement, inputs)
        deformation = body.rotation_strain.deformation(displacement)
        if factor is None:
            return Corrected(Solution(displacement, SolveStatus.INVERTED, iteration, np.inf), balance, None)
        if balance.norm < SADDLE:
            # Forces also balance at a saddle: only a positive definite tangent shows that the equilibrium is
            # stable.
            exact = exact_factor(body, balance)
            if exact is None:
                mode = body.pattern.scatter(_softest(factor, balance.residual))
                mode *= TILT * reach / longest_move(mode)
                displacement = body.rotation_strain.moved(displacement, deformation, mode)
                continue
            if balance.norm <= settings.tolerance:
                solution = Solution(displacement, SolveStatus.CONVERGED, iteration, balance.norm)
                return Corrected(solution, balance, exact)
        step = factor.solve(balance.residual)
        slope = float(step @ balance.residual)
        nodal = body.pattern.scatter(step)
        nodal *= min(1.0, reach / max(longest_move(nodal), 1e-300))
        for halving in range(10):
            after = body.rotation_strain.moved(displacement, deformation, nodal * 0.5**halving)
            trial = balancer(after, inputs, False)
            if trial.evaluation.valid and step @ trial.residual > -0.5 * slope:
                break
        displacement = after
    ended = Solution(displacement, SolveStatus.ITERATIONS, settings.descent, balance.norm)
    return Corrected(ended, balance, None)
