"""Small structured meshes of every element kind, for verification."""

from collections.abc import Callable
from dataclasses import replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.fem.shapes import HEX_EDGES, TET_EDGES
from softarm.estimator.mesh import ElementBlock, ElementKind, FacetKind, Floats, Indices, Mesh, Surface

TET_FACES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]
HEX_FACES = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
FACET_OF: dict[ElementKind, FacetKind] = {"tet4": "tri3", "tet10": "tri6", "hex8": "quad4", "hex20": "quad8"}

Predicate = Callable[[Floats], NDArray[np.bool_]]


def box(kind: ElementKind, counts: tuple[int, int, int], size: tuple[float, float, float]) -> Mesh:
    """Mesh a box from the origin to ``size``.

    Args:
        kind: Element kind; tetrahedra split each cell in six.
        counts: Cells along each axis.
        size: Edge lengths [m].

    Returns:
        A mesh with the single region ``body`` and neither surfaces nor node sets.
    """
    axes = [np.linspace(0.0, length, count + 1) for length, count in zip(size, counts, strict=True)]
    grid = np.meshgrid(*axes, indexing="ij")
    points = np.column_stack([g.ravel() for g in grid])
    number = np.arange(len(points)).reshape(grid[0].shape)
    ranges = [(slice(0, count), slice(1, count + 1)) for count in counts]
    corner = [number[i, j, k].ravel() for k in ranges[2] for j in ranges[1] for i in ranges[0]]
    cells = np.column_stack(corner)
    connectivity = cells[:, [0, 1, 3, 2, 4, 5, 7, 6]] if kind.startswith("hex") else _split(cells)
    if kind in {"tet10", "hex20"}:
        points, connectivity = _with_middles(
            points, connectivity, HEX_EDGES if kind == "hex20" else TET_EDGES
        )
    block = ElementBlock(kind, connectivity, np.zeros(len(connectivity), dtype=np.int64))
    return Mesh(points, (block,), ("body",))


def _split(cells: Indices) -> Indices:
    """Split cells in six tetrahedra along their diagonal (Kuhn), corner bits x, y, z."""
    parts = []
    for first, second, _ in permutations((1, 2, 4)):
        path = [0, first, first + second, 7]
        if (first, second) in {(2, 1), (1, 4), (4, 2)}:
            path[1], path[2] = path[2], path[1]
        parts.append(cells[:, path])
    return np.concatenate(parts)


def _with_middles(points: Floats, connectivity: Indices, edges: Indices) -> tuple[Floats, Indices]:
    """Add a node in the middle of every edge."""
    ends = np.sort(connectivity[:, edges].reshape(-1, 2), axis=1)
    unique, inverse = np.unique(ends, axis=0, return_inverse=True)
    middles = 0.5 * (points[unique[:, 0]] + points[unique[:, 1]])
    added = len(points) + inverse.reshape(len(connectivity), len(edges))
    return np.vstack([points, middles]), np.hstack([connectivity, added])


def mapped(mesh: Mesh, shape: Callable[[Floats], Floats]) -> Mesh:
    """Move the points of a mesh by a map, shape (nodes, 3) to (nodes, 3)."""
    return replace(mesh, points=shape(mesh.points))


def with_nodes(mesh: Mesh, name: str, where: Predicate) -> Mesh:
    """Name the nodes for which a predicate of the points holds."""
    return replace(mesh, node_sets={**mesh.node_sets, name: np.flatnonzero(where(mesh.points))})


def with_surface(mesh: Mesh, name: str, where: Predicate) -> Mesh:
    """Name the boundary facets for whose corners' mean a predicate holds, oriented out of the solid."""
    block = mesh.blocks[0]
    facets = boundary(block)
    corners = 3 if block.kind.startswith("tet") else 4
    chosen = facets[where(mesh.points[facets[:, :corners]].mean(axis=1))]
    return replace(mesh, surfaces={**mesh.surfaces, name: Surface(FACET_OF[block.kind], chosen)})


def boundary(block: ElementBlock) -> Indices:
    """List the facets that belong to one element only, in VTK order."""
    tetrahedral = block.kind.startswith("tet")
    faces = TET_FACES if tetrahedral else HEX_FACES
    edges = TET_EDGES if tetrahedral else HEX_EDGES
    middle = {tuple(sorted(edge)): (4 if tetrahedral else 8) + k for k, edge in enumerate(edges.tolist())}
    quadratic = block.kind in {"tet10", "hex20"}
    facets = []
    for face in faces:
        ends = [tuple(sorted((face[k], face[(k + 1) % len(face)]))) for k in range(len(face))]
        local = [*face, *(middle[end] for end in ends)] if quadratic else list(face)
        facets.append(block.connectivity[:, local])
    stacked = np.concatenate(facets)
    _, inverse, times = np.unique(
        np.sort(stacked[:, : len(faces[0])], axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return np.asarray(stacked[times[inverse.ravel()] == 1])
