"""Meshes: nodes, element blocks with regions, named surfaces and node sets."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats, Indices

Singles = NDArray[np.float32]
ElementKind = Literal["tet4", "tet10", "hex8", "hex20"]
FacetKind = Literal["tri3", "tri6", "quad4", "quad8"]


@dataclass(frozen=True)
class ElementBlock:
    """Elements of one kind.

    Node order is that of VTK (and meshio): corners first, then mid-edge nodes; for ``hex20`` the edges of
    the bottom face, of the top face, then the vertical ones.

    Args:
        kind: Element kind.
        connectivity: Node of each element corner and edge, shape (elements, nodes per element).
        region: Index into ``Mesh.regions`` of each element, shape (elements,).
    """

    kind: ElementKind
    connectivity: Indices
    region: Indices


@dataclass(frozen=True)
class ElementSurface:
    """Facets of one kind; their normals (right-hand rule over the corners) point out of the solid.

    Args:
        kind: Facet kind, VTK node order.
        facets: Node indices, shape (facets, nodes per facet).
    """

    kind: FacetKind
    facets: Indices


@dataclass(frozen=True)
class Mesh:
    """A body at rest in its base frame: origin at the clamp, z from the base to the tip.

    Args:
        points: Rest positions of the nodes [m], shape (nodes, 3).
        blocks: Element blocks.
        regions: Names of the material regions, indexed by ``ElementBlock.region``.
        surfaces: Named surfaces; ``chamber_<k>`` is the closed wall of chamber k.
        node_sets: Named node sets; ``clamp`` is held, ``section_<name>`` carries a rigid section's frame.
    """

    points: Floats
    blocks: tuple[ElementBlock, ...]
    regions: tuple[str, ...]
    surfaces: Mapping[str, ElementSurface] = field(default_factory=dict)
    node_sets: Mapping[str, Indices] = field(default_factory=dict)


def without_orphans(mesh: Mesh) -> Mesh:
    """Drop the nodes that no element uses, which would leave the stiffness singular.

    Facets on such nodes are dropped with them, node sets keep what remains of them; the order is kept.
    """
    used = np.zeros(len(mesh.points), dtype=bool)
    for block in mesh.blocks:
        used[block.connectivity] = True
    # New numbers of the nodes that stay; entries of the others are never read.
    number = np.cumsum(used) - 1

    def members(nodes: Indices) -> Indices:
        return number[nodes[used[nodes]]]

    return Mesh(
        points=mesh.points[used],
        blocks=tuple(ElementBlock(b.kind, number[b.connectivity], b.region) for b in mesh.blocks),
        regions=mesh.regions,
        surfaces={
            name: ElementSurface(surface.kind, number[surface.facets[used[surface.facets].all(axis=1)]])
            for name, surface in mesh.surfaces.items()
        },
        node_sets={name: members(nodes) for name, nodes in mesh.node_sets.items()},
    )
