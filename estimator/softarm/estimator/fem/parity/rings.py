"""Rings of points on the wall of a chamber, where thread is wound."""

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.mesh import ElementSurface
from softarm.estimator.reference_elements import CORNERS
from softarm.estimator.shape_functions import shape_functions

# Of a facet's side: a ring crosses curved facets in so many straight pieces.
SUBDIVISIONS = 8


def wall_rings(
    points: Floats, wall: ElementSurface, span: tuple[float, float], rings: int, bars: int
) -> tuple[Floats, Floats]:
    """Place rings of bars on a chamber's wall, evenly along the chamber and around it.

    Args:
        points: Rest positions of the nodes [m], shape (nodes, 3).
        wall: Wall of the chamber.
        span: Heights between which the chamber extends [m].
        rings: Number of rings.
        bars: Bars in each ring.

    Returns:
        Both ends of each bar [m], each of shape (rings bars, 3); all on the wall.
    """
    cells = _triangles(wall.kind)
    values, _ = shape_functions(wall.kind, cells.reshape(-1, 2))
    heights = (points[wall.facets, 2] @ values.T).reshape(len(wall.facets), -1, 3)
    first, second = [], []
    for ring in range(rings):
        level = span[0] + (ring + 0.5) / rings * (span[1] - span[0])
        facets, places = _crossings(cells, heights - level)
        on_wall, _ = shape_functions(wall.kind, places)
        crossings = np.einsum("pn,pni->pi", on_wall, points[wall.facets[facets]])
        corners = _evenly(crossings, bars)
        first.append(corners)
        second.append(np.roll(corners, -1, axis=0))
    return np.concatenate(first), np.concatenate(second)


def _triangles(kind: str) -> Floats:
    """Cut the parent of a facet into small triangles, shape (triangles, 3, 2)."""
    n = SUBDIVISIONS
    grid = np.linspace(-1.0 if CORNERS[kind] == 4 else 0.0, 1.0, n + 1)
    triangles = []
    for i in range(n):
        for j in range(n if CORNERS[kind] == 4 else n - i):
            a, b = (grid[i], grid[j]), (grid[i + 1], grid[j])
            c, d = (grid[min(i + 1, n)], grid[min(j + 1, n)]), (grid[i], grid[j + 1])
            triangles.append((a, b, d))
            if CORNERS[kind] == 4 or i + j < n - 1:
                triangles.append((b, c, d))
    return np.array(triangles)


def _crossings(cells: Floats, heights: Floats) -> tuple[Indices, Floats]:
    """Find where triangle edges cross height 0: the facet of each crossing and its parent coordinates."""
    facets, places = [], []
    for start, end in ((0, 1), (1, 2), (2, 0)):
        below, above = heights[..., start], heights[..., end]
        facet, cell = np.nonzero((below < 0.0) != (above < 0.0))
        share = (below[facet, cell] / (below[facet, cell] - above[facet, cell]))[:, None]
        facets.append(facet)
        places.append((1.0 - share) * cells[cell, start] + share * cells[cell, end])
    return np.concatenate(facets), np.concatenate(places)


def _evenly(points: Floats, count: int) -> Floats:
    """Pick points that follow one another at even distances around their centre, shape (count, 3)."""
    offset = points[:, :2] - points[:, :2].mean(axis=0)
    ordered = points[np.argsort(np.arctan2(offset[:, 1], offset[:, 0]))]
    steps = np.linalg.norm(np.roll(ordered, -1, axis=0) - ordered, axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)[:-1]])
    wanted = steps.sum() * np.arange(count) / count
    picked: Floats = ordered[np.searchsorted(along, wanted, side="right") - 1]
    return picked
