"""Shape functions, quadrature, and the volume form of the element and facet kinds."""

from collections.abc import Callable
from itertools import combinations

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.reference_elements import (
    HEX_CORNERS,
    HEX_EDGES,
    QUAD_CORNERS,
    QUAD_EDGES,
    TET_EDGES,
    TRI_EDGES,
)

Shape = tuple[Floats, Floats]


def _simplex(points: Floats) -> Shape:
    """Compute the barycentric coordinates (points, d + 1) and their gradients (points, d + 1, d)."""
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
    """Compute the serendipity functions: corners corrected by half of each adjacent mid-edge one."""
    middles = 0.5 * (corners[edges[:, 0]] + corners[edges[:, 1]])
    # At its middle an edge's own coordinate is 0 and the others are -1 or 1.
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
    """Return the quadrature points, shape (points, dimension), and weights of a kind in parent coordinates.

    The 20-node hexahedron is integrated with 2 x 2 x 2 points (reduced), which keeps it free of locking.
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


def volume_form(kind: str) -> tuple[Indices, Floats]:
    """Expand 1/3 int x . (x,s x x,t) ds dt over a facet in determinants of its nodes.

    The determinants are those of triples a < b < c, shape (terms, 3), with coefficients, shape (terms,).
    """
    if kind.startswith("tri"):
        # Degree 4 in barycentric coordinates: collapse a 4 x 4 Gauss rule onto the triangle.
        nodes, weights = np.polynomial.legendre.leggauss(4)
        u, v = (0.5 + 0.5 * g.ravel() for g in np.meshgrid(nodes, nodes, indexing="ij"))
        points = np.column_stack([u, v * (1.0 - u)])
        measure = 0.25 * np.outer(weights, weights).ravel() * (1.0 - u)
    else:
        points, measure = _gauss(4, 2)
    value, slope = shape_functions(kind, points)
    form = np.einsum("q,qa,qb,qc->abc", measure, value, slope[:, :, 0], slope[:, :, 1]) / 3.0
    # A determinant changes sign when two nodes change places: only the alternating part of the form counts.
    odd = form.transpose(1, 0, 2) + form.transpose(0, 2, 1) + form.transpose(2, 1, 0)
    alternating = form + form.transpose(1, 2, 0) + form.transpose(2, 0, 1) - odd
    triples = np.array(list(combinations(range(value.shape[1]), 3)))
    coefficients = alternating[triples[:, 0], triples[:, 1], triples[:, 2]]
    # Most triples vanish by symmetry, and each that stays costs time in every evaluation of a chamber.
    keep = np.abs(coefficients) > 1e-14
    return triples[keep], coefficients[keep]
