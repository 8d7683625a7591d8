"""Meshes of hexahedra turned into meshes of other elements on the same body."""

from dataclasses import replace

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.mesh import ElementBlock, ElementKind, ElementSurface, FacetKind, Mesh, without_orphans
from softarm.estimator.reference_elements import ELEMENT_FACES, HEX_EDGES, TET_EDGES, parent_nodes
from softarm.estimator.shape_functions import shape_functions


def to_elements(mesh: Mesh, kind: ElementKind) -> Mesh:
    """Mesh the body of 20-node hexahedra with elements of another kind.

    Linear elements drop the mid-edge nodes; tetrahedra split every hexahedron into six, each face along the
    diagonal through its lowest node, so that neighbours agree (Dompierre, Labbe, Vallet and Camarero 1999).
    Quadratic tetrahedra keep the curved edges.

    Args:
        mesh: Mesh of one block of ``hex20``.
        kind: Kind wanted.
    """
    if kind == "hex20":
        return mesh
    block = mesh.blocks[0]
    if kind in ("hex8", "tet4"):
        mesh = replace(mesh, node_sets=_corner_sets(mesh))
    if kind == "hex8":
        surfaces = {name: ElementSurface("quad4", s.facets[:, :4]) for name, s in mesh.surfaces.items()}
        hexahedra = ElementBlock("hex8", block.connectivity[:, :8], block.region)
        return without_orphans(Mesh(mesh.points, (hexahedra,), mesh.regions, surfaces, mesh.node_sets))
    corners, region = _split(block.connectivity[:, :8]), np.repeat(block.region, 6)
    triangles = {name: _halve(s.facets[:, :4]) for name, s in mesh.surfaces.items()}
    if kind == "tet4":
        return _tetrahedra(mesh, mesh.points, "tet4", corners, region, "tri3", triangles)
    middles = _Middles(mesh)
    elements = np.hstack([corners, middles.of(corners, TET_EDGES)])
    curved = {name: np.hstack([f, middles.of(f, TET_EDGES[:3])]) for name, f in triangles.items()}
    points = np.vstack([mesh.points, *middles.added])
    return _tetrahedra(mesh, points, "tet10", elements, region, "tri6", curved)


def _corner_sets(mesh: Mesh) -> dict[str, Indices]:
    """Make node sets of corners only; a set of mid-edge nodes becomes that of their edges' ends."""
    connectivity = mesh.blocks[0].connectivity
    corners = np.unique(connectivity[:, :8])
    ends = {
        int(middle): pair
        for edge, pair_of in enumerate(HEX_EDGES)
        for middle, pair in zip(connectivity[:, 8 + edge], connectivity[:, pair_of], strict=True)
    }
    found = {}
    for name, nodes in mesh.node_sets.items():
        kept = np.intersect1d(nodes, corners)
        if not len(kept):
            kept = np.unique([ends[int(node)] for node in nodes])
        found[name] = kept
    return found


def _tetrahedra(
    mesh: Mesh,
    points: Floats,
    kind: ElementKind,
    connectivity: Indices,
    region: Indices,
    facet_kind: FacetKind,
    facets: dict[str, Indices],
) -> Mesh:
    surfaces = {name: ElementSurface(facet_kind, nodes) for name, nodes in facets.items()}
    block = ElementBlock(kind, connectivity, region)
    return without_orphans(Mesh(points, (block,), mesh.regions, surfaces, mesh.node_sets))


def _halve(quads: Indices) -> Indices:
    """Split quadrilaterals along the diagonal through their lowest node, shape (2 quads, 3)."""
    start = np.argmin(quads, axis=1)
    turned = np.take_along_axis(quads, (start[:, None] + np.arange(4)) % 4, axis=1)
    return np.stack([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]], axis=1).reshape(-1, 3)


def _split(hexahedra: Indices) -> Indices:
    """Split hexahedra into six tetrahedra each, shape (6 hexahedra, 4).

    The lowest node sees the three faces that do not hold it; each is halved, and every half makes a
    tetrahedron with that node.
    """
    apex = hexahedra.min(axis=1)
    faces = hexahedra[:, ELEMENT_FACES["hex8"]]
    far = ~(faces == apex[:, None, None]).any(axis=2)
    bases = _halve(faces[far]).reshape(-1, 6, 3)
    tops = np.broadcast_to(apex[:, None, None], (*bases.shape[:2], 1))
    return np.concatenate([bases[..., ::-1], tops], axis=2).reshape(-1, 4)


class _Middles:
    """Nodes half-way along the edges of tetrahedra: those of the hexahedra, and new ones on diagonals."""

    def __init__(self, mesh: Mesh) -> None:
        self.number: dict[tuple[int, int], int] = {}
        self.added: list[Floats] = []
        self.count = len(mesh.points)
        parent = parent_nodes("hex20")
        connectivity = mesh.blocks[0].connectivity
        pairs = [(a, b) for a in range(8) for b in range(a)]
        places = np.array([0.5 * (parent[a] + parent[b]) for a, b in pairs])
        values, _ = shape_functions("hex20", places)
        for (a, b), place, value in zip(pairs, places, values, strict=True):
            known = np.flatnonzero((parent[8:] == place).all(axis=1))
            keys = np.sort(connectivity[:, [a, b]], axis=1)
            if len(known):
                self._store(keys, connectivity[:, 8 + known[0]])
            else:
                points = np.einsum("n,eni->ei", value, mesh.points[connectivity])
                self._store(keys, self.count + np.arange(len(points)))
                self.added.append(points)
                self.count += len(points)

    def _store(self, keys: Indices, nodes: Indices) -> None:
        for (low, high), node in zip(keys.tolist(), nodes.tolist(), strict=True):
            self.number.setdefault((low, high), node)

    def of(self, cells: Indices, edges: Indices) -> Indices:
        """Look up the middle node of each edge of each cell, shape (cells, edges)."""
        columns = []
        for a, b in edges:
            keys = np.sort(cells[:, [a, b]], axis=1).tolist()
            columns.append([self.number[low, high] for low, high in keys])
        return np.array(columns, dtype=np.int64).T
