"""Shape functions and quadrature of the element and facet kinds, node order of VTK."""

from collections.abc import Callable

import numpy as np

from softarm.estimator.mesh import Floats

TET_EDGES = np.array([(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)])
HEX_CORNERS = np.array(
    [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)],
    dtype=float,
)
HEX_EDGES = np.array(
    [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
)
QUAD_CORNERS = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], dtype=float)
QUAD_EDGES = np.array([(0, 1), (1, 2), (2, 3), (3, 0)])
TRI_EDGES = np.array([(0, 1), (1, 2), (2, 0)])

Shape = tuple[Floats, Floats]


def _simplex(points: Floats) -> Shape:
    """Give the barycentric coordinates (points, d + 1) and their gradients (points, d + 1, d)."""
    count, dimension = points.shape
    values = np.column_stack([1.0 - points.sum(axis=1), points])
    gradients = np.vstack([-np.ones(dimension), np.eye(dimension)])
    return values, np.broadcast_to(gradients, (count, dimension + 1, dimension)).copy()


def _quadratic_simplex(points: Floats, edges: Floats) -> Shape:
    corner, slope = _simplex(points)
    first, second = edges[:, 0], edges[:, 1]
    values = np.hstack([corner * (2.0 * corner - 1.0), 4.0 * corner[:, first] * corner[:, second]])
    of_corners = (4.0 * corner - 1.0)[:, :, None] * slope
    of_edges = 4.0 * (corner[:, first, None] * slope[:, second] + corner[:, second, None] * slope[:, first])
    return values, np.concatenate([of_corners, of_edges], axis=1)


def _product(factors: Floats, slopes: Floats) -> Shape:
    """Multiply one-dimensional factors (points, nodes, d) and apply the product rule."""
    dimension = factors.shape[2]
    gradients = np.empty_like(factors)
    for k in range(dimension):
        others = [m for m in range(dimension) if m != k]
        gradients[:, :, k] = slopes[:, :, k] * factors[:, :, others].prod(axis=2)
    return factors.prod(axis=2), gradients


def _multilinear(points: Floats, corners: Floats) -> Shape:
    factors = 0.5 * (1.0 + points[:, None, :] * corners)
    return _product(factors, np.broadcast_to(0.5 * corners, factors.shape))


def _serendipity(points: Floats, corners: Floats, edges: Floats) -> Shape:
    """Give the quadratic serendipity functions: corners corrected by half of each adjacent mid-edge one."""
    middles = 0.5 * (corners[edges[:, 0]] + corners[edges[:, 1]])
    along = middles == 0.0
    x = points[:, None, :]
    factors = np.where(along, 1.0 - x**2, 0.5 * (1.0 + x * middles))
    slopes = np.where(along, -2.0 * x, 0.5 * middles)
    value, gradient = _product(factors, np.broadcast_to(slopes, factors.shape))
    corner_value, corner_gradient = _multilinear(points, corners)
    for edge, ends in enumerate(edges):
        for corner in ends:
            corner_value[:, corner] -= 0.5 * value[:, edge]
            corner_gradient[:, corner] -= 0.5 * gradient[:, edge]
    return np.hstack([corner_value, value]), np.concatenate([corner_gradient, gradient], axis=1)


SHAPES: dict[str, Callable[[Floats], Shape]] = {
    "tri3": _simplex,
    "tri6": lambda points: _quadratic_simplex(points, TRI_EDGES),
    "quad4": lambda points: _multilinear(points, QUAD_CORNERS),
    "quad8": lambda points: _serendipity(points, QUAD_CORNERS, QUAD_EDGES),
    "tet4": _simplex,
    "tet10": lambda points: _quadratic_simplex(points, TET_EDGES),
    "hex8": lambda points: _multilinear(points, HEX_CORNERS),
    "hex20": lambda points: _serendipity(points, HEX_CORNERS, HEX_EDGES),
}


def shape_functions(kind: str, points: Floats) -> Shape:
    """Evaluate the shape functions of an element or a facet.

    Args:
        kind: Element or facet kind.
        points: Parent coordinates, shape (points, dimension); simplices use [0, 1], the others [-1, 1].

    Returns:
        Values, shape (points, nodes), and gradients in parent coordinates, shape (points, nodes, dimension).
    """
    return SHAPES[kind](np.asarray(points, dtype=float))


def _gauss(order: int, dimension: int) -> tuple[Floats, Floats]:
    nodes, weights = np.polynomial.legendre.leggauss(order)
    grids = np.meshgrid(*([nodes] * dimension), indexing="ij")
    products = np.meshgrid(*([weights] * dimension), indexing="ij")
    return np.column_stack([g.ravel() for g in grids]), np.prod([p.ravel() for p in products], axis=0)


def _simplex_points(first: float, dimension: int, volume: float) -> tuple[Floats, Floats]:
    other = (1.0 - first) / dimension
    barycentric = np.full((dimension + 1, dimension + 1), other) + np.eye(dimension + 1) * (first - other)
    return barycentric[:, 1:].copy(), np.full(dimension + 1, volume / (dimension + 1))


def quadrature(kind: str) -> tuple[Floats, Floats]:
    """Give the quadrature points and weights of a kind.

    The 20-node hexahedron is integrated with 2 x 2 x 2 points (reduced), which keeps it free of locking.

    Returns:
        Points in parent coordinates, shape (points, dimension), and weights, shape (points,).
    """
    match kind:
        case "tet4":
            return np.full((1, 3), 0.25), np.array([1.0 / 6.0])
        case "tet10":
            return _simplex_points((5.0 + 3.0 * np.sqrt(5.0)) / 20.0, 3, 1.0 / 6.0)
        case "hex8" | "hex20":
            return _gauss(2, 3)
        case "tri3":
            return np.full((1, 2), 1.0 / 3.0), np.array([0.5])
        case "tri6":
            return _simplex_points(2.0 / 3.0, 2, 0.5)
        case "quad4" | "quad8":
            return _gauss(2, 2)
        case _:
            raise ValueError(f"unknown kind {kind!r}")


def parent_nodes(kind: str) -> Floats:
    """Give the nodes' parent coordinates, shape (nodes, dimension)."""
    match kind:
        case "tet4" | "tet10":
            corners, edges = np.vstack([np.zeros(3), np.eye(3)]), TET_EDGES
        case "tri3" | "tri6":
            corners, edges = np.vstack([np.zeros(2), np.eye(2)]), TRI_EDGES
        case "hex8" | "hex20":
            corners, edges = HEX_CORNERS, HEX_EDGES
        case _:
            corners, edges = QUAD_CORNERS, QUAD_EDGES
    if kind in {"tet10", "tri6", "hex20", "quad8"}:
        return np.vstack([corners, 0.5 * (corners[edges[:, 0]] + corners[edges[:, 1]])])
    return corners


def inside_violation(kind: str, points: Floats) -> Floats:
    """Measure by how much parent coordinates leave the element; at most 0 inside, shape (points,)."""
    if kind.startswith("tet"):
        return np.asarray(np.maximum((-points).max(axis=1), points.sum(axis=1) - 1.0))
    return np.asarray(np.abs(points).max(axis=1) - 1.0)
