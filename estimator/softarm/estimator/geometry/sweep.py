"""Sweep of a meshed cross-section along z into 20-node hexahedra with curved edges."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from softarm.estimator.arrays import Floats, Indices
from softarm.estimator.geometry.faces import boundary_faces, element_faces, is_among
from softarm.estimator.geometry.patches import Patch, PatchLayout, build_plan
from softarm.estimator.geometry.resolution import Resolution
from softarm.estimator.mesh import ElementBlock, ElementSurface, Mesh, without_orphans
from softarm.estimator.specimen import Specimen

LEVEL_TOLERANCE_M = 1e-9


def sweep(
    specimen: Specimen,
    patches: Callable[[float], Sequence[Patch]],
    lobes: Sequence[tuple[int, ...]],
    breaks: Sequence[float],
    resolution: Resolution,
) -> Mesh:
    """Sweep a cross-section from the base to the tip.

    Args:
        specimen: The parts along the axis and the chambers.
        patches: Patches of the cross-section at a height [m].
        lobes: Chambers in each lobe of the cross-section.
        breaks: Further heights [m] at which a layer has to end.
        resolution: Divisions.

    Returns:
        The mesh, with regions named like the parts, surfaces ``chamber_<k>`` and ``outer``, and the node sets
        ``clamp`` and ``section_<name>``.
    """
    levels = layer_heights(specimen, breaks, resolution)
    # At any height: sizes change along the arm, but not which patches share a side.
    plan = build_plan(patches(0.5 * (levels[0] + levels[1])))
    points, connectivity = _extrude(plan, patches, levels)
    middle = 0.5 * (levels[:-1] + levels[1:])
    parts = specimen.parts
    region = np.array([_part_at(specimen, height) for height in middle])
    chamber = _chamber_cells(specimen, plan, lobes, middle)
    solid = np.flatnonzero(chamber < 0)
    block = ElementBlock("hex20", connectivity[solid], np.repeat(region, len(plan.quads))[solid])
    surfaces = _surfaces(block, connectivity, chamber, len(specimen.chambers))
    sets = _node_sets(specimen, points, np.unique(block.connectivity))
    return without_orphans(Mesh(points, (block,), tuple(p.name for p in parts), surfaces, sets))


def layer_heights(specimen: Specimen, breaks: Sequence[float], resolution: Resolution) -> Floats:
    """Compute the heights of the layers' ends [m], rising."""
    chambers = [height for chamber in specimen.chambers for height in (chamber.from_m, chamber.to_m)]
    soft = {segment.name for segment in specimen.segments}
    heights = [specimen.parts[0].from_m]
    for part in specimen.parts:
        inside = {h for h in (*breaks, *chambers) if part.from_m < h < part.to_m}
        knots = sorted({part.from_m, part.to_m} | inside)
        count = resolution.layers if part.name in soft else resolution.section_layers
        for start, end in pairwise(knots):
            share = max(1, round(count * (end - start) / (part.to_m - part.from_m)))
            heights += list(start + (end - start) * _spacing(share, resolution.end_layer)[1:])
    fine = np.arange(resolution.refinement * (len(heights) - 1) + 1) / resolution.refinement
    return np.interp(fine, np.arange(len(heights)), heights)


def _spacing(count: int, end_layer: float) -> Floats:
    """Compute the relative ends of ``count`` layers, the first and last of another thickness; from 0 to 1."""
    widths = np.ones(count)
    if count > 2:
        widths[[0, -1]] = end_layer
    return np.concatenate([[0.0], np.cumsum(widths) / widths.sum()])


def _extrude(
    plan: PatchLayout, patches: Callable[[float], Sequence[Patch]], levels: Floats
) -> tuple[Floats, Indices]:
    """Place all nodes, and number those of every cell, cavities included; layer after layer."""
    count, layers = plan.nodes, len(levels) - 1
    heights = np.empty(2 * layers + 1)
    # The ends of the layers, and between them the middles of their vertical edges.
    heights[::2], heights[1::2] = levels, 0.5 * (levels[:-1] + levels[1:])
    points = np.concatenate([np.column_stack([plan.place(patches(z)), np.full(count, z)]) for z in heights])
    corners, sides = plan.quads[:, :4], plan.quads[:, 4:]
    # VTK's order: corners below and above, then the edges below, above and between.
    cell = np.concatenate([corners, corners + 2 * count, sides, sides + 2 * count, corners + count], axis=1)
    offsets = 2 * count * np.arange(layers)
    return points, (cell[None] + offsets[:, None, None]).reshape(-1, 20)


def _part_at(specimen: Specimen, height: float) -> int:
    return next(i for i, part in enumerate(specimen.parts) if part.from_m <= height <= part.to_m)


def _chamber_cells(
    specimen: Specimen, plan: PatchLayout, lobes: Sequence[tuple[int, ...]], middle: Floats
) -> Indices:
    """Compute the chamber that each cell belongs to, -1 for solid, shape (layers quads,)."""
    cells = np.full((len(middle), len(plan.quads)), -1)
    for lobe, members in enumerate(lobes):
        for index in members:
            chamber = specimen.chambers[index]
            rows = (middle > chamber.from_m) & (middle < chamber.to_m)
            cells[np.ix_(rows, plan.cavity == lobe)] = index
    return cells.ravel()


def _surfaces(
    block: ElementBlock, cells: Indices, chamber: Indices, chambers: int
) -> dict[str, ElementSurface]:
    """Find the walls of the chambers, and what remains of the boundary."""
    boundary = boundary_faces("hex20", block.connectivity)
    outer = np.ones(len(boundary), dtype=bool)
    surfaces = {}
    for index in range(chambers):
        wall = is_among("quad8", boundary, element_faces("hex20", cells[chamber == index]))
        surfaces[f"chamber_{index}"] = ElementSurface("quad8", boundary[wall])
        outer &= ~wall
    surfaces["outer"] = ElementSurface("quad8", boundary[outer])
    return surfaces


def _node_sets(specimen: Specimen, points: Floats, used: Indices) -> dict[str, Indices]:
    """Find the held nodes and, for each section, those at the height of its frame's origin."""
    heights = points[used, 2]
    sets = {"clamp": used[heights <= specimen.clamp.up_to_m + LEVEL_TOLERANCE_M]}
    for section in specimen.sections:
        within = (heights >= section.from_m - LEVEL_TOLERANCE_M) & (
            heights <= section.to_m + LEVEL_TOLERANCE_M
        )
        levels = np.unique(heights[within])
        level = levels[np.argmin(np.abs(levels - section.frame_origin_m[2]))]
        sets[f"section_{section.name}"] = used[np.abs(heights - level) <= LEVEL_TOLERANCE_M]
    return sets
