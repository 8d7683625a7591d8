"""Where a specimen's cross-section is silicone and where it is hollow, sampled on a grid."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.estimator.specimen import Block, Chamber, Cylinder, QuadrantCylinder, Specimen, SweptLobes
from softarm.fakes.plant.slices import MeshSlices

Mask = NDArray[np.bool_]
Outline = Callable[[float, Floats, tuple[Chamber, ...]], tuple[Mask, list[Mask]]]
"""From a height [m], points [m], shape (points, 2), and the chambers there: inside the outer boundary, and
inside each chamber."""


def outline_of(specimen: Specimen) -> tuple[Outline, float]:
    """Return the outline of a specimen's body, and the half width of the square around it [m].

    Raises:
        InputError: A mesh file cannot be read or has no chamber where the specimen has one.
    """
    shape = specimen.geometry
    match shape:
        case SweptLobes():
            widest = max(shape.lobe_radii_m)
            azimuths = [c.azimuth_rad for c in specimen.chambers if c.segment == specimen.segments[0].name]
            return _lobes(shape, azimuths), widest * (1.0 + 1.0 / np.sqrt(3.0))
        case QuadrantCylinder() | Cylinder():
            return _cylinder(shape), shape.outer_radius_m
        case Block():
            return _block(shape), 0.5 * max(shape.width_x_m, shape.width_y_m)
    slices = MeshSlices.read(specimen, shape)
    return slices.outline, slices.reach


def _lobes(shape: SweptLobes, azimuths: list[float]) -> Outline:
    def outline(height: float, points: Floats, chambers: tuple[Chamber, ...]) -> tuple[Mask, list[Mask]]:
        radius = float(np.interp(height, shape.station_heights_m, shape.lobe_radii_m))
        side = radius / np.sqrt(3.0)
        out = {azimuth: _seen_from(azimuth, points) for azimuth in azimuths}
        core = np.logical_and.reduce([along <= side for along, _ in out.values()])
        rims = [np.hypot(along - side, across) <= radius for along, across in out.values()]
        hollows = []
        for chamber in chambers:
            along, across = _seen_from(chamber.azimuth_rad, points)
            inner = np.hypot(along - side, across) < radius - shape.wall_m
            hollows.append(inner & (along - side > shape.floor_m))
        return np.logical_or.reduce([core, *rims]), hollows

    return outline


def _cylinder(shape: QuadrantCylinder | Cylinder) -> Outline:
    inner, half = shape.outer_radius_m - shape.wall_m, 0.5 * shape.wall_m

    def outline(_: float, points: Floats, chambers: tuple[Chamber, ...]) -> tuple[Mask, list[Mask]]:
        distance, hollows = np.hypot(*points.T), []
        middle = np.pi / max(1, len(chambers))
        for chamber in chambers:
            along, across = _seen_from(chamber.azimuth_rad, points)
            beyond = distance > shape.core_radius_m if isinstance(shape, Cylinder) else (
                along > shape.core_m / np.sqrt(2.0)
            )  # fmt: skip
            wall = along * np.sin(middle) - np.abs(across) * np.cos(middle) > half
            hollows.append((distance < inner) & beyond & wall)
        return distance <= shape.outer_radius_m, hollows

    return outline


def _block(shape: Block) -> Outline:
    def outline(_: float, points: Floats, chambers: tuple[Chamber, ...]) -> tuple[Mask, list[Mask]]:  # noqa: ARG001
        inside = (np.abs(points[:, 0]) <= 0.5 * shape.width_x_m) & (
            np.abs(points[:, 1]) <= 0.5 * shape.width_y_m
        )
        return inside, []

    return outline


def _seen_from(azimuth: float, points: Floats) -> tuple[Floats, Floats]:
    """Return the coordinates of points along and across a direction."""
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    return points @ [cosine, sine], points @ [-sine, cosine]
