"""Structured meshes of a box in every element kind, for verification."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from acceptance.convert import to_elements
from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.geometry.faces import boundary_faces
from softarm.estimator.mesh import ElementBlock, ElementKind, ElementSurface, Mesh
from softarm.estimator.reference_elements import CORNERS, FACE_KIND, HEX_EDGES

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
    cells = np.column_stack(corner)[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    points, connectivity = _with_middles(points, cells)
    block = ElementBlock("hex20", connectivity, np.zeros(len(connectivity), dtype=np.int64))
    return to_elements(Mesh(points, (block,), ("body",)), kind)


def _with_middles(points: Floats, hexahedra: Indices) -> tuple[Floats, Indices]:
    """Add a node in the middle of every edge."""
    ends = np.sort(hexahedra[:, HEX_EDGES].reshape(-1, 2), axis=1)
    unique, inverse = np.unique(ends, axis=0, return_inverse=True)
    middles = 0.5 * (points[unique[:, 0]] + points[unique[:, 1]])
    added = len(points) + inverse.reshape(len(hexahedra), len(HEX_EDGES))
    return np.vstack([points, middles]), np.hstack([hexahedra, added])


def mapped(mesh: Mesh, shape: Callable[[Floats], Floats]) -> Mesh:
    """Move the points of a mesh by a map, shape (nodes, 3) to (nodes, 3)."""
    return replace(mesh, points=shape(mesh.points))


def with_nodes(mesh: Mesh, name: str, where: Predicate) -> Mesh:
    """Name the nodes for which a predicate of the points holds."""
    return replace(mesh, node_sets={**mesh.node_sets, name: np.flatnonzero(where(mesh.points))})


def with_surface(mesh: Mesh, name: str, where: Predicate) -> Mesh:
    """Name the boundary facets for whose corners' mean a predicate holds, oriented out of the solid."""
    block = mesh.blocks[0]
    facets, kind = boundary_faces(block.kind, block.connectivity), FACE_KIND[block.kind]
    chosen = facets[where(mesh.points[facets[:, : CORNERS[kind]]].mean(axis=1))]
    return replace(mesh, surfaces={**mesh.surfaces, name: ElementSurface(kind, chosen)})
