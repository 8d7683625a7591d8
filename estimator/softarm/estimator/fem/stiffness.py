"""A factored tangent with the responses that tracking reads off it, kept while it still serves."""

from dataclasses import dataclass

from softarm.estimator.fem.model import FiniteElementModel, FiniteElementState
from softarm.estimator.fem.substitution import CompactFactor
from softarm.estimator.mesh import Floats, Singles
from softarm.estimator.model import Inputs


@dataclass(frozen=True)
class Stiffness:
    """The tangent at one configuration.

    Args:
        displacement: The configuration [m], shape (nodes, 3).
        factor: Its factor, for steps that the next residual corrects.
        fields: Displacement per unit of each pressure, then each load, shape (inputs, nodes, 3).
        motion: Change of the stacked section twists per unit of each input, shape (6 sections, inputs).
        inverse: Inverse deformation gradients, a field of ``Transport``.
        sections: Rotations of the sections, shape (sections, 3, 3).
    """

    displacement: Floats
    factor: CompactFactor
    fields: Floats
    motion: Floats
    inverse: Singles
    sections: Floats


def take_stiffness(model: FiniteElementModel, displacement: Floats, inputs: Inputs) -> Stiffness | None:
    """Factor the tangent at a configuration; None where an element is inverted."""
    step = model.linearise(FiniteElementState(displacement, inputs), inputs)
    if step.factor is None:
        return None
    fields = model.body.pattern.scatter(step.factor.solve(step.input_forces()))
    sections, transport = model.section_fit, model.body.transport
    fitted = sections.at(model.body.points + displacement)
    return Stiffness(
        displacement=displacement,
        factor=step.factor.compact(),
        fields=fields,
        motion=fitted.twists(sections.weights @ fields).T,
        inverse=transport.inverse(transport.deformation(displacement)),
        sections=fitted.frames.rotations,
    )
