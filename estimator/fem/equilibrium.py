"""Newton's iteration to equilibrium, with load stepping."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estimator.fem.body import Body, Evaluation
from estimator.fem.factor import StiffnessFactor
from estimator.fem.pattern import Tangent
from estimator.fem.solution import Solution, SolveStatus
from estimator.mesh import Floats
from estimator.model import Inputs

GROWTH_LIMIT = 1e8
SHIFT = 1e-3


@dataclass(frozen=True)
class Settings:
    """Limits of the iteration.

    Args:
        tolerance: Out-of-balance force over the applied force at which it is converged.
        iterations: Linear solves allowed in one load step.
        smallest_step: Fraction of the change of load at which halving ends.
        total_iterations: Linear solves allowed in one call.
        longest_move: Largest displacement of a node in one iteration, over the body's size.
    """

    tolerance: float = 1e-9
    iterations: int = 14
    smallest_step: float = 1.0 / 512.0
    total_iterations: int = 400
    longest_move: float = 0.25


@dataclass(frozen=True)
class Balance:
    """Forces at a configuration under given inputs.

    Args:
        evaluation: Internal forces, volumes and tangent.
        residual: Applied less internal force on the free nodes [N], shape (3 free,).
        load_vectors: Nodal forces per unit of each load, shape (loads, nodes, 3).
        norm: Norm of the residual over that of the applied forces.
    """

    evaluation: Evaluation
    residual: Floats
    load_vectors: Floats
    norm: float


Balancer = Callable[[Floats, Inputs, bool, bool], Balance]


def stable_factor(
    body: Body, balancer: Balancer, displacement: Floats, inputs: Inputs
) -> tuple[Balance, StiffnessFactor | None]:
    """Evaluate and factor the tangent, or the nearest stand-in that is positive definite.

    An indefinite tangent loses first the pressures' load stiffness, then is shifted by a growing multiple of
    its diagonal's mean. The balance is that of the exact forces in every case.

    Returns:
        The balance, and the factor; None when the configuration is invalid or everything is singular.
    """
    balance = balancer(displacement, inputs, True, True)
    if not balance.evaluation.valid:
        return balance, None
    factor = _factor(body, balance)
    if factor is not None:
        return balance, factor
    without = balancer(displacement, inputs, True, False)
    factor = _factor(body, without)
    shift = SHIFT
    while factor is None and shift < 1e3:
        factor = body.plan.factorise(shifted(body, without, shift))
        shift *= 10.0
    return balance, factor


def _factor(body: Body, balance: Balance) -> StiffnessFactor | None:
    assert balance.evaluation.tangent is not None
    return body.plan.factorise(balance.evaluation.tangent)


def shifted(body: Body, balance: Balance, shift: float) -> Tangent:
    """Add a multiple of the mean diagonal to a tangent's diagonal."""
    assert balance.evaluation.tangent is not None
    values, mirror = balance.evaluation.tangent.values.copy(), balance.evaluation.tangent.mirror.copy()
    diagonal = body.pattern.column_start[:-1]
    mean = np.abs(np.trace(values[diagonal], axis1=1, axis2=2)).mean() / 3.0
    for blocks in (values, mirror):
        blocks[diagonal] += shift * mean * np.eye(3)
    return Tangent(values, values if balance.evaluation.tangent.symmetric else mirror)


def newton(
    body: Body, balancer: Balancer, start: Floats, inputs: Inputs, settings: Settings
) -> Solution[Floats]:
    """Iterate to equilibrium under fixed inputs.

    Args:
        body: The body.
        balancer: Evaluates forces: (displacement, inputs, tangent, load stiffness) to ``Balance``.
        start: First displacement [m], shape (nodes, 3).
        inputs: Pressures, loads, gravity.
        settings: Limits.

    Returns:
        The displacement and how it ended.
    """
    displacement, first, reach = (
        start,
        np.inf,
        settings.longest_move * float(np.ptp(body.points, axis=0).max()),
    )
    for iteration in range(settings.iterations + 1):
        balance, factor = stable_factor(body, balancer, displacement, inputs)
        if not balance.evaluation.valid:
            return Solution(displacement, SolveStatus.INVERTED, iteration, np.inf)
        first = min(first, balance.norm)
        if balance.norm <= settings.tolerance:
            stable = _is_stable(body, balance)
            status = SolveStatus.CONVERGED if stable else SolveStatus.UNSTABLE
            return Solution(displacement, status, iteration, balance.norm)
        if factor is None or balance.norm > GROWTH_LIMIT * first:
            return Solution(displacement, SolveStatus.STALLED, iteration, balance.norm)
        if iteration == settings.iterations:
            break
        displacement = take_step(
            balancer, displacement, body.pattern.scatter(factor.solve(balance.residual)), inputs, reach
        )
    return Solution(displacement, SolveStatus.ITERATIONS, settings.iterations, balance.norm)


def _is_stable(body: Body, balance: Balance) -> bool:
    return _factor(body, balance) is not None or not body.symmetric


def take_step(balancer: Balancer, displacement: Floats, step: Floats, inputs: Inputs, reach: float) -> Floats:
    """Move by a step, shortened to ``reach`` [m] and halved while it inverts an element (8 times at most)."""
    longest = float(np.sqrt((step**2).sum(axis=1).max()))
    if not np.isfinite(longest):
        return displacement
    step = step * min(1.0, reach / max(longest, 1e-300))
    for _ in range(8):
        if balancer(displacement + step, inputs, False, False).evaluation.valid:
            break
        step = 0.5 * step
    return displacement + step


def between(first: Inputs, second: Inputs, fraction: float) -> Inputs:
    """Interpolate inputs."""
    return Inputs(
        *(
            a + fraction * (b - a)
            for a, b in zip(
                (first.pressures, first.loads, first.gravity),
                (second.pressures, second.loads, second.gravity),
                strict=True,
            )
        )
    )


def follow(
    body: Body, balancer: Balancer, start: Floats, origin: Inputs, target: Inputs, settings: Settings
) -> Solution[Floats]:
    """Bring a body from equilibrium under ``origin`` to equilibrium under ``target``.

    The whole change is tried first; what fails is halved, what succeeds is doubled. A path that cannot be
    continued ends with the status of its last failure and the last equilibrium reached.

    Returns:
        The displacement and how it ended; ``residual_norm`` is taken at the displacement under ``target``.
    """
    displacement, done, step, spent = start, 0.0, 1.0, 0
    last = SolveStatus.STALLED
    while done < 1.0:
        aim = min(1.0, done + step)
        found = newton(body, balancer, displacement, between(origin, target, aim), settings)
        spent += found.iterations
        if found.converged:
            displacement, done, step = found.value, aim, 2.0 * step
            continue
        last, step = found.status, 0.5 * min(step, aim - done)
        if spent >= settings.total_iterations:
            last = SolveStatus.ITERATIONS
            break
        if step < settings.smallest_step:
            break
    norm = balancer(displacement, target, False, False).norm
    return Solution(displacement, SolveStatus.CONVERGED if done >= 1.0 else last, spent, norm)
