"""A factored tangent with the responses that tracking reads off it, kept while it still serves."""

from dataclasses import dataclass

import numpy as np

from estimator.fem.factor import StiffnessFactor
from estimator.fem.model import FiniteElementModel, FiniteElementState, FiniteElementStep
from estimator.mesh import Floats
from estimator.model import Inputs


@dataclass(frozen=True)
class Stiffness:
    """The tangent at one configuration.

    Args:
        factor: Its factor.
        adjoint: K^-T J^T for the unit twists J of all sections, shape (6 sections, 3 free).
    """

    factor: StiffnessFactor
    adjoint: Floats


def take_stiffness(model: FiniteElementModel, displacement: Floats, inputs: Inputs) -> Stiffness | None:
    """Factor the tangent at a configuration; None where an element is inverted."""
    step = model.linearise(FiniteElementState(displacement, inputs), inputs)
    return stiffness_of(step)


def stiffness_of(step: FiniteElementStep) -> Stiffness | None:
    """Keep the tangent of a linearisation; None where it has none."""
    if step.factor is None:
        return None
    rows = step.nodal_rows(np.eye(6 * len(step.poses)))
    moving = rows.any(axis=1)
    adjoint = np.zeros_like(rows)
    adjoint[moving] = step.factor.solve_transposed(rows[moving])
    return Stiffness(step.factor, adjoint)
