"""The part of the arm's surface that a finding names."""

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.specimen import Specimen
from softarm.estimator.specimen.physics import Place
from softarm.page.scene import LAYER_M

ROUNDING = 1e-9
Nodes = NDArray[np.bool_]


def nodes_at(rest_m: Floats, specimen: Specimen, where: Place) -> Nodes:
    """Return which nodes of the surface lie at a place; none where it names no part of the arm.

    Args:
        rest_m: Nodes of the unloaded arm [m], shape (nodes, 3).
        specimen: The arm.
        where: A chamber, segment or section, or a sensor, which stands for the section that carries it.

    Returns:
        Shape (nodes,).
    """
    if where.chamber is not None and where.chamber < len(specimen.chambers):
        return _sector(rest_m, specimen, where.chamber)
    named = {part.name: part for part in specimen.named_parts}
    name = where.segment or where.section or _carrier(specimen, where.sensor or "")
    if name not in named:
        return np.zeros(len(rest_m), dtype=np.bool_)
    return _between(rest_m, named[name].from_m, named[name].to_m)


def _sector(rest_m: Floats, specimen: Specimen, index: int) -> Nodes:
    """Return the nodes on a chamber: those of its height that are nearest to it about the axis."""
    chamber = specimen.chambers[index]
    beside = sum(other.from_m == chamber.from_m for other in specimen.chambers)
    azimuths = np.arctan2(rest_m[:, 1], rest_m[:, 0]) - chamber.azimuth_rad
    near = np.abs(np.angle(np.exp(1j * azimuths))) <= np.pi / beside + ROUNDING
    return np.asarray(near & _between(rest_m, chamber.from_m, chamber.to_m))


def _between(rest_m: Floats, from_m: float, to_m: float) -> Nodes:
    """Return the nodes between two heights, or those nearest to them."""
    distance = np.abs(rest_m[:, 2] - np.clip(rest_m[:, 2], from_m, to_m))
    return np.asarray(distance <= distance.min() + LAYER_M)


def _carrier(specimen: Specimen, sensor: str) -> str:
    """Name the section of a sensor such as ``bend_tip`` or ``marker_tip1``."""
    carriers = {f"marker_{marker.name}": marker.section for marker in specimen.markers}
    return carriers.get(sensor, sensor.partition("_")[2])
