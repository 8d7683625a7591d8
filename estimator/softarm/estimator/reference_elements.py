"""Reference elements: corners, edges and faces of each kind, in the node order of VTK."""

from collections.abc import Mapping

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.mesh import ElementKind, FacetKind

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

# Faces as seen from outside, corners counter-clockwise, then their mid-edge nodes.
_TET = np.array([(0, 2, 1, 6, 5, 4), (0, 1, 3, 4, 8, 7), (1, 2, 3, 5, 9, 8), (0, 3, 2, 7, 9, 6)])
_HEX = np.array(
    [
        (0, 3, 2, 1, 11, 10, 9, 8),
        (4, 5, 6, 7, 12, 13, 14, 15),
        (0, 1, 5, 4, 8, 17, 12, 16),
        (1, 2, 6, 5, 9, 18, 13, 17),
        (2, 3, 7, 6, 10, 19, 14, 18),
        (3, 0, 4, 7, 11, 16, 15, 19),
    ]
)
ELEMENT_FACES: Mapping[str, Indices] = {
    "tet4": _TET[:, :3],
    "tet10": _TET,
    "hex8": _HEX[:, :4],
    "hex20": _HEX,
}
FACE_KIND: Mapping[ElementKind, FacetKind] = {
    "tet4": "tri3",
    "tet10": "tri6",
    "hex8": "quad4",
    "hex20": "quad8",
}
CORNERS = {"tri3": 3, "tri6": 3, "quad4": 4, "quad8": 4}


def parent_nodes(kind: str) -> Floats:
    """Return the nodes' parent coordinates, shape (nodes, dimension)."""
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
