"""The surface of an arm's body in a state of its model, for pictures."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.fem import FiniteElementModel, FiniteElementState
from softarm.estimator.mesh import Mesh
from softarm.estimator.reference_elements import CORNERS
from softarm.estimator.rod import CalibratedRod
from softarm.estimator.rod.skin import skin


@dataclass(frozen=True)
class BodySurface:
    """The body's surface.

    Args:
        points: Nodes in the base frame [m], shape (nodes, 3).
        facets: Corners of each facet, shape (facets, corners).
    """

    points: Floats
    facets: NDArray[np.int64]


def outer_surface(model: FiniteElementModel, state: FiniteElementState) -> BodySurface:
    """Return the deformed outer surface; that of all chambers where the mesh names none."""
    return BodySurface(model.body.points + state.displacement, _facets(model.mesh))


def skin_surface(mesh: Mesh, rod: CalibratedRod, strain: Floats) -> BodySurface:
    """Return the surface around a rod, the cross-sections as they are at rest."""
    return BodySurface(skin(mesh.points, rod.chain, strain), _facets(mesh))


def _facets(mesh: Mesh) -> NDArray[np.int64]:
    surfaces = mesh.surfaces
    chosen = [surfaces["outer"]] if "outer" in surfaces else list(surfaces.values())
    facets: list[NDArray[np.int64]] = [
        surface.facets[:, : CORNERS[surface.kind]] for surface in chosen if CORNERS[surface.kind] == 4
    ]
    triangles = [surface.facets[:, :3] for surface in chosen if CORNERS[surface.kind] == 3]
    facets += [np.column_stack([t, t[:, 2]]) for t in triangles]
    return np.concatenate(facets)
