"""Discrete springs between material points, as in the published model."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.fem.elements.fibre import Bars
from softarm.estimator.fem.interpolation import points_inside
from softarm.estimator.mesh import Mesh


@dataclass(frozen=True)
class Springs:
    """Discrete springs between material points, as in the published model (1e4 N/m around each chamber).

    Args:
        name: What ``FiniteElementModel.parameters`` calls them.
        first: One end at rest [m], shape (springs, 3).
        second: The other end at rest [m], shape (springs, 3).
        stiffness: Force per elongation [N/m].
    """

    name: str
    first: Floats
    second: Floats
    stiffness: float


def build_springs(mesh: Mesh, springs: Springs, parameter: int) -> Bars:
    """Map both ends of each spring on the nodes of the elements that hold them."""
    ends = [points_inside(mesh, end, f"springs {springs.name}") for end in (springs.first, springs.second)]
    length = np.linalg.norm(springs.second - springs.first, axis=1)
    gradients = np.hstack([-ends[0].weights, ends[1].weights]) / length[:, None]
    count = gradients.shape[1]
    return Bars(
        nodes=np.hstack([ends[0].nodes, ends[1].nodes]),
        gradients=np.ascontiguousarray(gradients),
        stiffness=springs.stiffness * length**2,
        parameter=np.full(len(length), parameter),
        slots=np.empty((0, count, count), dtype=np.int32),
    )
