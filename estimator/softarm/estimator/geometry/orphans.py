"""Nodes that belong to no element."""

import numpy as np

from softarm.estimator.arrays import Indices
from softarm.estimator.mesh import ElementBlock, ElementSurface, Mesh


def without_orphans(mesh: Mesh) -> Mesh:
    """Drop the nodes that no element uses, which would leave the stiffness singular.

    Facets on such nodes are dropped with them, node sets keep what remains of them; the order is kept.
    """
    used = np.zeros(len(mesh.points), dtype=bool)
    for block in mesh.blocks:
        used[block.connectivity] = True
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
