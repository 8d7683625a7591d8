"""The cross-section of the arm: what is silicone, what is chamber, and how it resists."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats

Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]

SECTORS_PER_LOBE = 4
SECTORS = 12
SPACING = 0.2e-3


@dataclass(frozen=True)
class CrossSection:
    """Lumped cross-section.

    Args:
        fibres: Centres of the silicone fibres [m], shape (fibres, 2).
        areas: Their areas [m2], shape (fibres,).
        chambers: Centroids of the chambers [m], shape (chambers, 2).
        chamber_areas: Their areas [m2], shape (chambers,).
        second_moment: About an axis through the centre, mean of x and y [m4].
        radius: Of the circle around it [m].
    """

    fibres: Floats
    areas: Floats
    chambers: Floats
    chamber_areas: Floats
    second_moment: float
    radius: float


@lru_cache(maxsize=256)
def lobed(
    radius: float, wall: float, floor: float, fibre_depth: float, azimuths: tuple[float, ...]
) -> CrossSection:
    """Sample a triangle of side 2 ``radius`` with a half disc and its chamber on each side.

    One third about the first lobe is sampled and rotated to each azimuth. The silicone is gathered in an
    inner and an outer ring of fibres, one per sector, each at the centroid of its share; distances are then
    scaled so that the second moment is that of the full section.

    The result is shared between calls with the same arguments: do not write to its arrays.

    Args:
        radius: Of the half discs [m].
        wall: Thickness outside the chamber [m].
        floor: Between the triangle's side and the chamber [m].
        fibre_depth: Depth of the fibres in the wall of the chamber; they bound the area that pushes [m].
        azimuths: Directions of the three half discs [rad].
    """
    side = radius / np.sqrt(3.0)
    reach = side + radius
    points = _grid(reach)
    out, across = points[:, 0] - side, points[:, 1]
    distance = np.hypot(out, across)
    third = np.abs(np.arctan2(across, points[:, 0])) <= np.pi / 3.0
    solid = third & ((out <= 0.0) | (distance <= radius))
    hollow = (out > floor) & (distance < radius - wall)
    silicone = points[solid & ~hollow]
    fibres, areas = _gather(silicone)
    full = float((silicone**2).sum()) * SPACING**2
    fibres *= np.sqrt(full / float(areas @ (fibres**2).sum(axis=1)))
    pushing = (out > floor - fibre_depth) & (distance < radius - wall + fibre_depth)
    centroid = points[pushing].mean(axis=0)
    return CrossSection(
        fibres=np.concatenate([_rotate(fibres, azimuth) for azimuth in azimuths]),
        areas=np.tile(areas, len(azimuths)),
        chambers=np.concatenate([_rotate(centroid[None], azimuth) for azimuth in azimuths]),
        chamber_areas=np.full(len(azimuths), int(pushing.sum()) * SPACING**2),
        second_moment=0.5 * len(azimuths) * full,
        radius=reach,
    )


def sampled(points: Floats, spacing: float, solid: Mask, chambers: Sequence[Mask]) -> CrossSection:
    """Lump a cross-section of any shape that is sampled on a square grid.

    Args:
        points: Of the grid [m], shape (points, 2).
        spacing: Of the grid [m].
        solid: Which points are silicone, shape (points,).
        chambers: Which points lie inside each chamber's winding; they push.
    """
    silicone = points[solid]
    angle = np.arctan2(silicone[:, 1], silicone[:, 0])
    sectors = np.minimum((angle / np.pi + 1.0) * (SECTORS // 2), SECTORS - 1).astype(int)
    fibres, areas = _rings(silicone, sectors, SECTORS, spacing)
    moments = (silicone**2).sum() * spacing**2
    fibres *= np.sqrt(moments / float(areas @ (fibres**2).sum(axis=1)))
    return CrossSection(
        fibres=fibres,
        areas=areas,
        chambers=np.array([points[mask].mean(axis=0) for mask in chambers]).reshape(-1, 2),
        chamber_areas=np.array([mask.sum() * spacing**2 for mask in chambers], dtype=float),
        second_moment=0.5 * float(moments),
        radius=float(np.hypot(*silicone.T).max()),
    )


def _rings(points: Floats, sectors: Integers, count: int, spacing: float) -> tuple[Floats, Floats]:
    """Gather the points of each sector into two fibres, split at the median distance."""
    centres, areas = [], []
    for index in range(count):
        inside = points[sectors == index]
        far = np.hypot(inside[:, 0], inside[:, 1])
        outer = far > np.median(far)
        for ring in (~outer, outer):
            centres.append(inside[ring].mean(axis=0))
            areas.append(int(ring.sum()) * spacing**2)
    return np.array(centres), np.array(areas)


def _grid(reach: float) -> Floats:
    """Place points over a square about the origin, symmetric about the x axis, shape (points, 2)."""
    half = (np.arange(int(reach / SPACING) + 1) + 0.5) * SPACING
    axis = np.concatenate([-half[::-1], half])
    return np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)


def _rotate(points: Floats, angle: float) -> Floats:
    """Rotate points about the origin."""
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[cosine, sine], [-sine, cosine]]))


def _gather(points: Floats) -> tuple[Floats, Floats]:
    """Gather the points of one third into fibres: two rings in each sector, split at the median distance."""
    angle = np.arctan2(points[:, 1], points[:, 0]) / (2.0 * np.pi / 3.0) + 0.5
    sector = np.minimum((angle * SECTORS_PER_LOBE).astype(int), SECTORS_PER_LOBE - 1)
    return _rings(points, sector, SECTORS_PER_LOBE, SPACING)
