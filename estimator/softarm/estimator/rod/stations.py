"""Where to cut a specimen into links, and what each link carries."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from softarm.estimator.arm import region_materials
from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.fem import FiniteElementModel
from softarm.estimator.fem.interpolation import PointMap, cross_section, locate
from softarm.estimator.fem.sections import SectionFit, SectionFrame, frame_of_points
from softarm.estimator.mesh import Mesh
from softarm.estimator.rod.chain import Chain, point_weights
from softarm.estimator.rod.symmetry import candidates
from softarm.estimator.shape_functions import quadrature, shape_functions
from softarm.estimator.specimen import Section, Specimen

RASTER = 24
"""Points across a station, before their images."""
OUTSIDE = 1e-3
"""Distance from an element, in its own coordinates, from which an image of a point is off the body."""
NEAR = 1e-6
"""Heights closer than this are one station [m]."""


@dataclass(frozen=True)
class Stations:
    """Frames of the finite-element model at the stations, the clamp left out.

    Args:
        chain: The links between them.
        fit: Frames of the stations after the clamp.
    """

    chain: Chain
    fit: SectionFit

    def poses(self, positions: Floats, moves: Floats) -> tuple[Floats, Floats, Floats]:
        """Compute the stations' frames at current nodes, and their twists for moves of the nodes.

        Args:
            positions: Nodes [m], shape (nodes, 3).
            moves: Displacements of the nodes per unit of each input, shape (inputs, nodes, 3).

        Returns:
            Origins, shape (stations, 3), rotations, shape (stations, 3, 3), and twists (translation,
            rotation), shape (stations, 6, inputs).
        """
        poses = self.fit.at(positions)
        twists = poses.twists(moves).T.reshape(len(poses.levers), 6, len(moves))
        return poses.frames.positions, poses.frames.rotations, twists


def cut(specimen: Specimen, model: FiniteElementModel, links_per_segment: int = 4) -> Stations:
    """Cut an arm into links: each soft segment into equal parts, a station on every rigid section.

    The links at the ends of a segment reach into the rigid sections, to their middles.
    """
    clamp = specimen.clamp.up_to_m
    moving = [section for section in specimen.sections if section.to_m > clamp + NEAR]
    places: dict[float, SectionFrame] = {}
    for section in moving:
        height = 0.5 * (section.from_m + section.to_m)
        origin = np.array([0.0, 0.0, height])
        # The section's own nodes relative to the axis; where its frame lies in it is the specimen's
        # (`adapted`).
        places[height] = replace(model.frames[section.name], origin=origin, rotation=np.eye(3))
    for segment in specimen.segments:
        low, high = max(segment.from_m, clamp), segment.to_m
        for height in np.linspace(low, high, links_per_segment + 1)[1:-1]:
            places[float(height)] = _slice(specimen, model.mesh, float(height))
    heights = np.array([clamp, *sorted(places)])
    frames = tuple(places[height] for height in heights[1:].tolist())
    chain = _chain(specimen, model, heights)
    return Stations(chain, SectionFit.of(frames, len(model.mesh.points)))


def _slice(specimen: Specimen, mesh: Mesh, height: float) -> SectionFrame:
    """Prepare the frame of a cross-section, from points that lie as evenly about the axis as the arm does.

    A raster alone would make a symmetric arm seem lopsided.
    """
    raster = cross_section(mesh, height, RASTER).apply(mesh.points)
    images = [locate(mesh, raster @ symmetry.vectors.T) for symmetry in candidates(specimen)]
    kept = [image for image, violation in images if violation.max() < OUTSIDE]
    points = PointMap(
        np.concatenate([image.nodes for image in kept]), np.concatenate([image.weights for image in kept])
    )
    return frame_of_points(points, mesh, np.array([0.0, 0.0, height]), np.eye(3))


def _chain(specimen: Specimen, model: FiniteElementModel, heights: Floats) -> Chain:
    sections = [specimen.section(name) for name in model.sections]
    station = np.array([_station(section, heights) for section in sections], dtype=np.int64)
    origins = np.array([section.frame_origin_m for section in sections])
    on_axis = np.column_stack([np.zeros((len(sections), 2)), heights[station]])
    regions = tuple(_region(specimen, low, high) for low, high in pairwise(heights.tolist()))
    mass, centre, weights = _masses(specimen, model.mesh, heights)
    return Chain(
        heights=heights,
        sections=tuple(model.sections),
        section_station=station,
        section_offset=origins - on_axis,
        section_rotation=np.array([model.frames[section.name].rotation for section in sections]),
        regions=regions,
        chambers=_chambers(specimen, heights),
        chamber_count=len(specimen.chambers),
        mass=mass,
        mass_centre=centre,
        mass_weights=weights,
    )


def _station(section: Section, heights: Floats) -> int:
    height = 0.5 * (section.from_m + section.to_m)
    return int(np.argmin(np.abs(heights - max(height, heights[0]))))


def _region(specimen: Specimen, low: float, high: float) -> str:
    """Name the part that fills most of a link; a soft segment goes before a rigid section."""
    overlap = {part.name: min(high, part.to_m) - max(low, part.from_m) for part in specimen.parts}
    soft = {segment.name for segment in specimen.segments}
    return max(overlap, key=lambda name: (overlap[name] > NEAR and name in soft, overlap[name]))


def _chambers(specimen: Specimen, heights: Floats) -> Indices:
    """List the chambers that a link touches, or else those nearest to it."""
    rows = []
    for low, high in pairwise(heights.tolist()):
        gaps = {c.index: max(c.from_m - high, low - c.to_m) for c in specimen.chambers}
        # A negative gap is an overlap, of which any counts like a touch.
        least = max(min(gaps.values(), default=0.0), -NEAR)
        rows.append(sorted(index for index, distance in gaps.items() if distance <= least + NEAR))
    width = max((len(row) for row in rows), default=0)
    return np.array([[*row, *[-1] * (width - len(row))] for row in rows], dtype=np.int64).reshape(
        len(rows), width
    )


def _masses(specimen: Specimen, mesh: Mesh, heights: Floats) -> tuple[Floats, Floats, Floats]:
    """Share the mass among the links, each quadrature point of the elements a point load of its own."""
    links, lengths = len(heights) - 1, np.diff(heights)
    height, mass = _mass_points(specimen, mesh)
    link = np.clip(np.searchsorted(heights, height, side="right") - 1, 0, links - 1)
    share = np.clip((height - heights[link]) / lengths[link], 0.0, 1.0)
    # What lies below the clamp hangs on it.
    mass = np.where(height < heights[0], 0.0, mass)
    total = np.array([mass[link == i].sum() for i in range(links)])
    weight = mass / np.where(total > 0, total, 1.0)[link]
    parts = np.column_stack([share, point_weights(share, lengths[link])]) * weight[:, None]
    means = np.array([parts[link == i].sum(axis=0) for i in range(links)])
    # A share of 1 would put the whole weight on the far station; see `Actions`.
    return total, np.minimum(means[:, 0], 1.0 - 1e-9), np.ascontiguousarray(means[:, 1:])


def _mass_points(specimen: Specimen, mesh: Mesh) -> tuple[Floats, Floats]:
    """Compute height and mass of points spread finely through the elements."""
    densities = np.array([material.density for material in region_materials(specimen, mesh).values()])
    heights, masses = [], []
    for block in mesh.blocks:
        places, weights = _fine_rule() if block.kind.startswith("hex") else quadrature(block.kind)
        values, slopes = shape_functions(block.kind, places)
        corners = mesh.points[block.connectivity]
        volume = np.linalg.det(np.einsum("eni,qnk->eqik", corners, slopes)) * weights
        heights.append(np.einsum("en,qn->eq", corners[..., 2], values).ravel())
        masses.append((volume * densities[block.region][:, None]).ravel())
    return np.concatenate(heights), np.concatenate(masses)


def _fine_rule(cells: int = 8) -> tuple[Floats, Floats]:
    """Compute midpoints and sizes of equal cells of the parent cube: an element may be longer than a link."""
    middles = (np.arange(cells) + 0.5) * (2.0 / cells) - 1.0
    places = np.stack(np.meshgrid(middles, middles, middles, indexing="ij"), axis=-1).reshape(-1, 3)
    return places, np.full(cells**3, 8.0 / cells**3)
