"""A factored tangent with the responses that tracking reads off it, kept while it still serves."""

from dataclasses import dataclass

from softarm.estimator.arrays import Floats
from softarm.estimator.fem.linalg.cholesky import CholeskyFactor, SymmetricFactor
from softarm.estimator.fem.model import FiniteElementModel, FiniteElementState
from softarm.estimator.fem.tracking.single_factor import SingleFactor
from softarm.estimator.model import Inputs


@dataclass(frozen=True)
class FrozenTangent:
    """The tangent at one configuration.

    Args:
        displacement: The configuration [m], shape (nodes, 3).
        factor: Its factor, for steps that the next residual corrects.
        fields: Displacement per unit of each pressure, then each load, shape (inputs, nodes, 3).
        motion: Change of the stacked section twists per unit of each input, shape (6 sections, inputs).
        sections: Rotations of the sections, shape (sections, 3, 3).
    """

    displacement: Floats
    factor: SymmetricFactor
    fields: Floats
    motion: Floats
    sections: Floats


def freeze_tangent(
    model: FiniteElementModel, displacement: Floats, inputs: Inputs, *, single: bool = True
) -> FrozenTangent | None:
    """Factor the tangent at a configuration; None where an element is inverted.

    Args:
        model: The model.
        displacement: The configuration [m], shape (nodes, 3).
        inputs: Inputs.
        single: Whether the factor is kept in single precision, which halves the time of a solve.
    """
    step = model.linearise(FiniteElementState(displacement, inputs), inputs)
    if step.factor is None:
        return None
    fields = step.input_fields()
    return FrozenTangent(
        displacement=displacement,
        factor=_compact(step.factor.symmetric) if single else step.factor.symmetric,
        fields=fields,
        motion=step.poses.twists(fields).T,
        sections=step.frames.rotations,
    )


def _compact(factor: SymmetricFactor) -> SymmetricFactor:
    """Copy a factor to single precision where this package holds its numbers."""
    return SingleFactor.of(factor) if isinstance(factor, CholeskyFactor) else factor
