"""Fibres: one-dimensional stretch of a vector that is linear in the nodes.

Membranes on the chamber walls and the discrete circumferential springs are the same thing to the kernel: a
vector d = sum_a g_a x_a of length 1 at rest, whose strain e = |d| - 1 is resisted by the force
stiffness T(e). Springs have T = e. Threads buckle as soon as they are compressed by a strain s, after which
they carry no more: T = r(e + s) - r(s) with the rounded ramp r(x) = (x + sqrt(x^2 + s^2/4)) / 2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softarm.estimator.errors import InputError
from softarm.estimator.fem.compiled import compiled
from softarm.estimator.fem.interpolation import points_inside
from softarm.estimator.fem.pattern import Pattern, Slots
from softarm.estimator.fem.shapes import quadrature, shape_functions
from softarm.estimator.mesh import Floats, Indices, Mesh

END_CAP = 0.3


@dataclass(frozen=True)
class Membrane:
    """Fibres wound around a chamber, smeared over its wall.

    Args:
        surface: Named surface of the mesh.
        stiffness: Force per width per strain along the fibres [N/m].
        slack: Strain by which fibres are compressed when they buckle; ``inf`` for fibres that never do,
            such as those wound under tension.
        pitch: Angle by which the fibres climb towards +z off the circumferential direction [rad].
    """

    surface: str
    stiffness: float
    slack: float = np.inf
    pitch: float = 0.0


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


@dataclass(frozen=True)
class Bars:
    """Fibres of one width, ready for the kernel.

    Args:
        nodes: Nodes of each fibre, shape (bars, nodes).
        gradients: The coefficients g [1/m], shape (bars, nodes).
        stiffness: Energy per unit of squared strain, twice [J], shape (bars,).
        slack: Compressive strain at which each buckles, shape (bars,).
        parameter: Index of the factor that scales each, shape (bars,).
        slots: Where the blocks of each fibre go, shape (bars, nodes, nodes).
    """

    nodes: Indices
    gradients: Floats
    stiffness: Floats
    slack: Floats
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
            positions, self.nodes, self.gradients, scales[self.parameter] * self.stiffness, self.slack,
            self.slots, forces, values, tangent,
        )  # fmt: skip


def build_membrane(mesh: Mesh, membrane: Membrane, parameter: int) -> Bars:
    """Place fibres perpendicular to the arm's axis at the quadrature points of a wall.

    Facets whose normal is within about 17 degrees of the axis are end caps and carry none.
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
    around /= np.maximum(sine, END_CAP)[..., None]
    along = np.cross(normal, around)
    fibre = np.cos(membrane.pitch) * around + np.sin(membrane.pitch) * along
    metric = np.einsum("fqik,fqil->fqkl", tangents, tangents)
    covariant = np.einsum("fqik,fqi->fqk", tangents, fibre)
    parent = np.linalg.solve(metric, covariant[..., None])[..., 0]
    gradients = np.einsum("qnk,fqk->fqn", slopes, parent)
    keep = (sine > END_CAP).ravel()
    count = slopes.shape[1]
    nodes = np.repeat(surface.facets, len(weights), axis=0)[keep]
    return Bars(
        nodes=np.array(nodes, dtype=np.int64),
        gradients=np.ascontiguousarray(gradients.reshape(-1, count)[keep]),
        stiffness=(membrane.stiffness * weights * area).ravel()[keep],
        slack=np.full(int(keep.sum()), membrane.slack),
        parameter=np.full(int(keep.sum()), parameter),
        slots=np.empty((0, count, count), dtype=np.int32),
    )


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
        slack=np.full(len(length), np.inf),
        parameter=np.full(len(length), parameter),
        slots=np.empty((0, count, count), dtype=np.int32),
    )


def build_fibres(mesh: Mesh, fibres: Sequence[Membrane | Springs], first: int) -> tuple[Bars, ...]:
    """Prepare all fibres, those with the same number of nodes together.

    Args:
        mesh: Mesh at rest.
        fibres: Membranes and springs.
        first: Index of the first one's stiffness factor.

    Raises:
        InputError: A surface is unknown or a spring's end lies outside the body.
    """
    parts = []
    for index, fibre in enumerate(fibres, start=first):
        if isinstance(fibre, Springs):
            parts.append(build_springs(mesh, fibre, index))
        elif fibre.surface in mesh.surfaces:
            parts.append(build_membrane(mesh, fibre, index))
        else:
            known = ", ".join(mesh.surfaces)
            raise InputError(f"fibres on {fibre.surface!r}", "no such surface", f"use one of {known}")
    return _merge(parts)


def _merge(parts: Sequence[Bars]) -> tuple[Bars, ...]:
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
                slack=np.concatenate([part.slack for part in same]),
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
    slack: Floats,
    slots: Slots,
    forces: Floats,
    values: Floats,
    tangent: bool,
) -> None:
    """Add g_a k T n to the forces and g_a g_b k [T' n n^T + T/|d| (1 - n n^T)] to the tangent, n = d/|d|."""
    width = nodes.shape[1]
    block = np.empty((3, 3))
    d = np.empty(3)
    for m in range(nodes.shape[0]):
        for i in range(3):
            d[i] = 0.0
            for a in range(width):
                d[i] += gradients[m, a] * positions[nodes[m, a], i]
        length = np.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        pull, stretching = length - 1.0, 1.0
        if np.isfinite(slack[m]):
            past = length - 1.0 + slack[m]
            root = np.sqrt(past * past + 0.25 * slack[m] * slack[m])
            pull = 0.5 * (past + root) - (0.5 + 0.25 * np.sqrt(5.0)) * slack[m]
            stretching = 0.5 * (1.0 + past / root)
        pull *= stiffness[m] / length
        along = (stiffness[m] * stretching - pull) / (length * length)
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
