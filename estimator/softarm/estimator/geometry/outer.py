"""How far a body reaches from its axis."""

from functools import lru_cache
from pathlib import Path

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.geometry.groups import read_content
from softarm.estimator.specimen import Block, Cylinder, MeshFile, QuadrantCylinder, Specimen, SweptLobes
from softarm.estimator.specimen.entry import Quaternion, Vector

SLICES = 20
"""Parts of its height in which the outermost node of a mesh from a file is sought."""


def outer_radii(specimen: Specimen, heights: Floats) -> Floats:
    """Return the radius of the circle around the cross-section at some heights [m], shape (heights,).

    Args:
        specimen: The body.
        heights: Heights [m], shape (heights,).

    Raises:
        InputError: A mesh file cannot be read.
    """
    match specimen.geometry:
        case SweptLobes() as shape:
            lobes = np.interp(heights, shape.station_heights_m, shape.lobe_radii_m)
            return np.asarray(lobes * (1.0 + 1.0 / np.sqrt(3.0)))
        case QuadrantCylinder() | Cylinder() as shape:
            return np.full(len(heights), shape.outer_radius_m)
        case Block() as shape:
            return np.full(len(heights), 0.5 * float(np.hypot(shape.width_x_m, shape.width_y_m)))
        case MeshFile() as shape:
            path = specimen.folder / shape.path
            slices = _outermost(path, shape.metres_per_unit, shape.quaternion, shape.origin_m)
            return np.interp(heights, *slices)


@lru_cache(maxsize=8)
def _outermost(
    path: Path, metres_per_unit: float, quaternion: Quaternion, origin_m: Vector
) -> tuple[Floats, Floats]:
    """Return heights of slices of a mesh [m] and the distance of the outermost node in each [m]."""
    content = read_content(path)
    used = np.unique(np.concatenate([connectivity.ravel() for _, connectivity in content.blocks]))
    points = content.points_in_base(metres_per_unit, quaternion, origin_m)[used]
    distances = np.hypot(points[:, 0], points[:, 1])
    edges = np.linspace(points[:, 2].min(), points[:, 2].max(), SLICES + 1)
    slices = np.clip(np.searchsorted(edges, points[:, 2], side="right") - 1, 0, SLICES - 1)
    radii = np.zeros(SLICES)
    np.maximum.at(radii, slices, distances)
    filled = radii > 0.0
    return (0.5 * (edges[1:] + edges[:-1]))[filled], radii[filled]
