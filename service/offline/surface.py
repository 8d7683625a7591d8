"""The surface of the finite-element model's body in a state, for pictures."""

import numpy as np
from numpy.typing import NDArray

from estimator.fem import FiniteElementModel, FiniteElementState
from service.plots.arm import Surface

CORNERS = {"tri3": 3, "tri6": 3, "quad4": 4, "quad8": 4}


def outer_surface(model: FiniteElementModel, state: FiniteElementState) -> Surface:
    """Give the deformed outer surface; that of all chambers where the mesh names none."""
    surfaces = model.mesh.surfaces
    chosen = [surfaces["outer"]] if "outer" in surfaces else list(surfaces.values())
    facets: list[NDArray[np.int64]] = [
        surface.facets[:, : CORNERS[surface.kind]] for surface in chosen if CORNERS[surface.kind] == 4
    ]
    triangles = [surface.facets[:, :3] for surface in chosen if CORNERS[surface.kind] == 3]
    facets += [np.column_stack([t, t[:, 2]]) for t in triangles]
    return Surface(model.body.points + state.displacement, np.concatenate(facets))
