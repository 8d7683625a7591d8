"""The linear search of the whole library, and its scores where nothing is missing."""

from collections.abc import Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.evidence import RegressionProblem
from softarm.estimator.diagnosis.library import Direction
from softarm.estimator.diagnosis.marginal import Marginal, null_draws
from softarm.estimator.effects import ParameterSpec
from softarm.estimator.specimen.physics import EffectName

DRAWS = 400
INVISIBLE = 1e-3
"""Gain in cost of a typical effect below which it leaves no trace at all."""


def screen(
    evidence: RegressionProblem, marginal: Marginal, taken: frozenset[int]
) -> list[tuple[int, float, Floats]]:
    """Rank hypotheses by their linear gain less the penalty of their parameters.

    Args:
        evidence: Residuals and columns.
        marginal: What is left once all that is common to the recordings is marginalised.
        taken: Numbers of hypotheses that are left out.

    Returns:
        Number, score and parameters to start from of each, the best first.
    """
    best: dict[int, tuple[float, Floats]] = {}
    bic_penalty = np.log(max(marginal.count, 2.0))
    directions = evidence.library.directions
    for number, _, columns in evidence.library.groups():
        if number in taken:
            continue
        numbers = [evidence.nuisances + c for c in columns]
        if marginal.matrix[numbers, numbers].min() <= INVISIBLE:
            continue
        gain, values = marginal.gain(numbers)
        effect = evidence.library.hypotheses[number].effect
        theta, allowed = _start(effect.parameters, [directions[c] for c in columns], values)
        score = (gain if allowed else 0.0) - bic_penalty * effect.degrees_of_freedom
        if number not in best or score > best[number][0]:
            best[number] = (score, theta)
    ranked = [(number, score, theta) for number, (score, theta) in best.items()]
    return sorted(ranked, key=lambda entry: -entry[1])


def usual_gains(evidence: RegressionProblem, marginal: Marginal) -> dict[EffectName, float]:
    """Return by how much a usual share of each effect, anywhere on the arm, lowers the cost.

    What every arm may have of an effect leaves little to a change of it. It may still explain more than a
    change of any other effect.
    """
    columns: dict[EffectName, list[int]] = {}
    for column, name in enumerate(evidence.effects, evidence.nuisances):
        columns.setdefault(name, []).append(column)
    return {name: marginal.usual_gain(own) for name, own in columns.items()}


def null_scores(evidence: RegressionProblem, marginal: Marginal, rng: np.random.Generator) -> Floats:
    """Draw the best score of the whole screen where nothing is missing, shape (draws,)."""
    first = evidence.nuisances
    drawn = null_draws(marginal.matrix[first:, first:], rng, DRAWS)
    bic_penalty = np.log(max(marginal.count, 2.0))
    best = np.full(DRAWS, -np.inf)
    for number, _, columns in evidence.library.groups():
        numbers = [evidence.nuisances + c for c in columns]
        if marginal.matrix[numbers, numbers].min() <= INVISIBLE:
            continue
        block = marginal.matrix[np.ix_(numbers, numbers)]
        size = np.sqrt(np.maximum(np.diag(block), 1e-300))
        scaled = block / np.outer(size, size) + 1e-6 * np.eye(len(numbers))
        whitened = drawn[:, [k - first for k in numbers]] / size
        gains = (whitened * np.linalg.solve(scaled, whitened.T).T).sum(axis=1)
        effect = evidence.library.hypotheses[number].effect
        best = np.maximum(best, gains - bic_penalty * effect.degrees_of_freedom)
    return best


def _start(
    parameters: Sequence[ParameterSpec], directions: Sequence[Direction], values: Floats
) -> tuple[Floats, bool]:
    """Convert linear coefficients into parameters to start from; whether their signs are allowed."""
    theta = directions[0].theta.copy()
    allowed = True
    for direction, value in zip(directions, values.tolist(), strict=True):
        if direction.parameter < 0:
            allowed = allowed and value > 0.0
            continue
        bounds = parameters[direction.parameter]
        if bounds.lower >= 0.0 and value < 0.0 and len(directions) == 1:
            allowed = False
        theta[direction.parameter] = float(np.clip(value * direction.typical, bounds.lower, bounds.upper))
    return theta, allowed
