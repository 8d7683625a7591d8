"""The outer surface of an arm's mesh as it is drawn: its own nodes and triangles."""

from dataclasses import dataclass

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.mesh import Mesh
from softarm.estimator.reference_elements import CORNERS
from softarm_client.messages import Surface


@dataclass(frozen=True)
class DrawnSurface:
    """Which nodes of a mesh are drawn, and how they are joined.

    Args:
        nodes: Nodes of the mesh that are corners of the surface, shape (nodes,).
        triangles: Places in ``nodes``, counter-clockwise from outside, shape (triangles, 3).
    """

    nodes: Indices
    triangles: Indices

    def corners(self, points: Floats) -> Floats:
        """Return the corners of each triangle [m], shape (triangles, 3, 3), of the mesh's nodes [m]."""
        return points[self.nodes[self.triangles]]

    def message(self, mesh: Mesh) -> Surface:
        """Write what clients need to draw the stream ``shape``.

        Args:
            mesh: Mesh of the arm's body at rest.
        """
        rest = mesh.points[self.nodes].tolist()
        return Surface.model_validate({"triangles": self.triangles.tolist(), "rest_m": rest})


def drawn_surface(mesh: Mesh) -> DrawnSurface:
    """Find the surface to draw: the outer one, or all chambers where the mesh names none."""
    surfaces = mesh.surfaces
    chosen = [surfaces["outer"]] if "outer" in surfaces else list(surfaces.values())
    corners = np.concatenate([_triangles(surface.facets[:, : CORNERS[surface.kind]]) for surface in chosen])
    nodes, places = np.unique(corners, return_inverse=True)
    return DrawnSurface(nodes, places.reshape(-1, 3))


def _triangles(facets: Indices) -> Indices:
    """Cut quadrilaterals into triangles, shape (triangles, 3)."""
    if facets.shape[1] == 3:
        return facets
    return np.concatenate([facets[:, [0, 1, 2]], facets[:, [0, 2, 3]]])
