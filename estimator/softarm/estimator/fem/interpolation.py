"""Points inside the mesh as weighted sums of its nodes."""

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.errors import InputError
from softarm.estimator.mesh import Mesh
from softarm.estimator.reference_elements import inside_violation
from softarm.estimator.shape_functions import shape_functions

INVERSE_MAP_ITERATIONS = 12
# In parent coordinates, by which a sample of a cross-section may lie outside.
TOLERANCE = 1e-6


@dataclass(frozen=True)
class PointMap:
    """Material points that move with the mesh: x = sum_a N_a x_a.

    Args:
        nodes: Nodes of each point's element, padded with its first, shape (points, nodes).
        weights: Shape functions at the point, zero where padded, shape (points, nodes).
    """

    nodes: Indices
    weights: Floats

    def __len__(self) -> int:
        return len(self.nodes)

    def apply(self, nodal: Floats) -> Floats:
        """Interpolate nodal values, shape (nodes, ...) to (points, ...)."""
        return np.asarray(np.einsum("pn,pn...->p...", self.weights, nodal[self.nodes]))

    def matrix(self, nodes: int) -> sparse.csr_matrix:
        """Compute the interpolation as a matrix, shape (points, nodes)."""
        rows = np.repeat(np.arange(len(self)), self.nodes.shape[1])
        entries = (self.weights.ravel(), (rows, self.nodes.ravel()))
        return sparse.csr_matrix(entries, shape=(len(self), nodes))


def node_map(nodes: Indices) -> PointMap:
    """Map points that are mesh nodes, shape (points,)."""
    return PointMap(np.asarray(nodes, dtype=np.int64)[:, None], np.ones((len(nodes), 1)))


def _candidates(kind: str, corners: Floats, points: Floats) -> tuple[Indices, Indices]:
    """Pair points with the elements whose box holds them, along the axes and along the element's own."""
    pairs: list[tuple[Indices, Indices]] = []
    low, high = _box(corners)
    # In chunks, since points times elements is too large an array on a fine mesh.
    for start in range(0, len(points), 512):
        chunk = points[start : start + 512, None]
        which, element = np.nonzero(((chunk >= low) & (chunk <= high)).all(axis=2))
        pairs.append((which + start, element))
    which, element = (np.concatenate(part) for part in zip(*pairs, strict=True))
    # The box along the base frame's axes is wide about a slanted element; that along its own axes is not.
    values, slopes = shape_functions(kind, _middle(kind)[None])
    middle, to_own = values[0] @ corners, np.linalg.inv(_regular(corners.transpose(0, 2, 1) @ slopes[0]))
    low, high = _box((corners - middle[:, None]) @ to_own.transpose(0, 2, 1))
    local = (to_own[element] @ (points[which] - middle[element])[..., None])[..., 0]
    near = ((local >= low[element]) & (local <= high[element])).all(axis=1)
    return which[near], element[near]


def _box(corners: Floats) -> tuple[Floats, Floats]:
    """Bound each element, shape (elements, nodes, 3), with a margin for what curves beyond its nodes."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    margin = 0.05 * (high - low).max(axis=1, keepdims=True)
    return low - margin, high + margin


def _middle(kind: str) -> Floats:
    return np.full(3, 0.25 if kind.startswith("tet") else 0.0)


def _regular(jacobian: Floats) -> Floats:
    """Replace singular matrices by the identity."""
    return np.where(np.linalg.det(jacobian)[:, None, None] == 0.0, np.eye(3), jacobian)


def _parent(kind: str, corners: Floats, targets: Floats) -> Floats:
    """Invert the parent map by Newton's iteration, shape (pairs, 3)."""
    parent = np.tile(_middle(kind), (len(targets), 1))
    moving = np.arange(len(targets))
    for _ in range(INVERSE_MAP_ITERATIONS):
        values, slopes = shape_functions(kind, parent[moving])
        residual = targets[moving] - (values[:, None] @ corners[moving])[:, 0]
        jacobian = _regular(corners[moving].transpose(0, 2, 1) @ slopes)
        step = np.linalg.solve(jacobian, residual[..., None])[..., 0]
        # On a curved element a full first step may lead so far out that Newton's iteration does not return.
        parent[moving] += np.clip(step, -1.0, 1.0)
        moving = moving[np.abs(step).max(axis=1) >= 1e-12]
        if not len(moving):
            break
    return parent


def locate(mesh: Mesh, points: Floats) -> tuple[PointMap, Floats]:
    """Find the element that holds each point, or the nearest in parent coordinates.

    Args:
        mesh: Mesh at rest.
        points: Points at rest [m], shape (points, 3).

    Returns:
        The map, and by how much each point lies outside in parent coordinates (at most 0 inside; infinity
        where no element is near), shape (points,).
    """
    width = max(block.connectivity.shape[1] for block in mesh.blocks)
    nodes = np.zeros((len(points), width), dtype=np.int64)
    weights = np.zeros((len(points), width))
    violation = np.full(len(points), np.inf)
    for block in mesh.blocks:
        which, element = _candidates(block.kind, mesh.points[block.connectivity], points)
        connectivity = block.connectivity[element]
        parent = _parent(block.kind, mesh.points[connectivity], points[which])
        outside = inside_violation(block.kind, parent)
        order = np.lexsort((outside, which))
        # Of the elements near a point, that in which it lies deepest.
        first = order[np.concatenate([[True], np.diff(which[order]) > 0])] if len(order) else order
        better = first[outside[first] < violation[which[first]]]
        target, size = which[better], connectivity.shape[1]
        violation[target] = outside[better]
        # Padded with a node of the element itself, so that no foreign node is coupled to the point.
        nodes[target] = connectivity[better, :1]
        nodes[target, :size] = connectivity[better]
        weights[target] = 0.0
        weights[target, :size] = shape_functions(block.kind, parent[better])[0]
    return PointMap(nodes, weights), violation


def points_inside(mesh: Mesh, points: Floats, where: str) -> PointMap:
    """Map points that must lie in the mesh.

    Raises:
        InputError: A point lies outside.
    """
    interpolation, violation = locate(mesh, points)
    if (violation > 1e-3).any():
        index = int(np.argmax(violation))
        raise InputError(
            where, f"point {index} at {points[index].tolist()} m is outside the body", "move it inside"
        )
    return interpolation


def cross_section(mesh: Mesh, height: float, resolution: int = 48) -> PointMap:
    """Sample the body's cross-section at a height uniformly, and keep the samples that lie in the body.

    Args:
        mesh: Mesh at rest.
        height: Distance from the base along z [m].
        resolution: Samples along the larger side of the bounding box.

    Raises:
        InputError: The height is outside the body.
    """
    used = np.unique(np.concatenate([block.connectivity.ravel() for block in mesh.blocks]))
    low, high = mesh.points[used].min(axis=0), mesh.points[used].max(axis=0)
    where = f"load or section at height {height} m"
    if not low[2] <= height <= high[2]:
        raise InputError(
            where, f"the body spans {low[2]:.4f} to {high[2]:.4f} m", "choose a height within the body"
        )
    spacing = (high[:2] - low[:2]).max() / resolution
    axes = [np.arange(low[k] + 0.5 * spacing, high[k], spacing) for k in range(2)]
    x, y = (grid.ravel() for grid in np.meshgrid(*axes, indexing="ij"))
    interpolation, violation = locate(mesh, np.column_stack([x, y, np.full(len(x), height)]))
    keep = violation <= TOLERANCE
    if not keep.any():
        raise InputError(where, "the cross-section there is empty", "choose a height within the body")
    return PointMap(interpolation.nodes[keep], interpolation.weights[keep])
