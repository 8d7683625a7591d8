"""Fibres: one-dimensional stretch of a vector that is linear in the nodes.

Membranes on the chamber walls and discrete springs are the same thing to the kernel: a vector
d = sum_a g_a x_a of length 1 at rest, whose strain e = |d| - 1 is resisted by the force stiffness e.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.fem.compiled import compiled
from softarm.estimator.fem.linalg.pattern import Pattern, Slots
from softarm.estimator.mesh import Mesh
from softarm.estimator.shape_functions import quadrature, shape_functions

END_CAP = 0.3
"""Sine of the angle between a facet's normal and the arm's axis below which the facet is an end cap."""


@dataclass(frozen=True)
class Membrane:
    """Fibres wound around a chamber, smeared over its wall.

    Args:
        surface: Named surface of the mesh.
        stiffness: Force per width per strain along the fibres [N/m].
    """

    surface: str
    stiffness: float


@dataclass(frozen=True)
class Bars:
    """Fibres of one width, ready for the kernel.

    Args:
        nodes: Nodes of each fibre, shape (bars, nodes).
        gradients: The coefficients g [1/m], shape (bars, nodes).
        stiffness: Energy per unit of squared strain, twice [J], shape (bars,).
        parameter: Index of the factor that scales each, shape (bars,).
        slots: Where the blocks of each fibre go, shape (bars, nodes, nodes).
    """

    nodes: Indices
    gradients: Floats
    stiffness: Floats
    parameter: Indices
    slots: Slots

    def attach(self, pattern: Pattern) -> "Bars":
        """Find where the blocks go in a pattern."""
        return replace(self, slots=pattern.locate(self.nodes))

    def forces(
        self, positions: Floats, scales: Floats, forces: Floats, values: Floats, tangent: bool
    ) -> None:
        """Add the internal forces and, where wanted, the tangent; arguments as for ``Solids.forces``."""
        bar_forces(
            positions, self.nodes, self.gradients, scales[self.parameter] * self.stiffness,
            self.slots, forces, values, tangent,
        )  # fmt: skip


def build_membrane(mesh: Mesh, membrane: Membrane, parameter: int) -> Bars:
    """Place fibres perpendicular to the arm's axis at the quadrature points of a wall.

    End caps carry none.
    """
    surface = mesh.surfaces[membrane.surface]
    places, weights = quadrature(surface.kind)
    slopes = shape_functions(surface.kind, places)[1]
    tangents = np.einsum("fni,qnk->fqik", mesh.points[surface.facets], slopes)
    normal = np.cross(tangents[..., 0], tangents[..., 1])
    area = np.linalg.norm(normal, axis=2)
    normal /= area[..., None]
    around = np.cross([0.0, 0.0, 1.0], normal)
    sine = np.linalg.norm(around, axis=2)
    # A unit vector wherever a fibre stays; on end caps, which are dropped below, only finite.
    around /= np.maximum(sine, END_CAP)[..., None]
    metric = np.einsum("fqik,fqil->fqkl", tangents, tangents)
    covariant = np.einsum("fqik,fqi->fqk", tangents, around)
    # The fibre's direction in the facet's own coordinates, in which the shape functions are differentiated.
    parent = np.linalg.solve(metric, covariant[..., None])[..., 0]
    gradients = np.einsum("qnk,fqk->fqn", slopes, parent)
    keep = (sine > END_CAP).ravel()
    count = slopes.shape[1]
    nodes = np.repeat(surface.facets, len(weights), axis=0)[keep]
    return Bars(
        nodes=np.array(nodes, dtype=np.int64),
        gradients=np.ascontiguousarray(gradients.reshape(-1, count)[keep]),
        stiffness=(membrane.stiffness * weights * area).ravel()[keep],
        parameter=np.full(int(keep.sum()), parameter),
        slots=np.empty((0, count, count), dtype=np.int32),
    )


def merge_bars(parts: Sequence[Bars]) -> tuple[Bars, ...]:
    """Join fibres of equal width."""
    widths = sorted({part.nodes.shape[1] for part in parts})
    merged = []
    for width in widths:
        same = [part for part in parts if part.nodes.shape[1] == width]
        merged.append(
            Bars(
                nodes=np.concatenate([part.nodes for part in same]),
                gradients=np.concatenate([part.gradients for part in same]),
                stiffness=np.concatenate([part.stiffness for part in same]),
                parameter=np.concatenate([part.parameter for part in same]),
                slots=same[0].slots,
            )
        )
    return tuple(merged)


@compiled
def bar_forces(  # noqa: C901 (one loop nest, compiled)
    positions: Floats,
    nodes: Indices,
    gradients: Floats,
    stiffness: Floats,
    slots: Slots,
    forces: Floats,
    values: Floats,
    tangent: bool,
) -> None:
    """Add g_a k e n to the forces and g_a g_b k [n n^T + e/|d| (1 - n n^T)] to the tangent, n = d/|d|."""
    width = nodes.shape[1]
    block = np.empty((3, 3))
    d = np.empty(3)
    for m in range(nodes.shape[0]):
        for i in range(3):
            d[i] = 0.0
            for a in range(width):
                d[i] += gradients[m, a] * positions[nodes[m, a], i]
        length = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        pull = stiffness[m] * (length - 1.0) / length
        along = (stiffness[m] - pull) / (length * length)
        for a in range(width):
            for i in range(3):
                forces[nodes[m, a], i] += gradients[m, a] * pull * d[i]
        if not tangent:
            continue
        for i in range(3):
            for k in range(3):
                block[i, k] = along * d[i] * d[k] + (pull if i == k else 0.0)
        for a in range(width):
            for b in range(width):
                slot = slots[m, a, b]
                if slot >= 0:
                    weight = gradients[m, a] * gradients[m, b]
                    for i in range(3):
                        for k in range(3):
                            values[slot, i, k] += weight * block[i, k]
