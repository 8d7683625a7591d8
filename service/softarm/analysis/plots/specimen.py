"""A specimen as softarm understands it: its body at rest, its chambers, its sections."""

from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from softarm.analysis.plots.figures import MM_PER_M, blank
from softarm.estimator.arrays import Floats
from softarm.estimator.geometry import DEFAULTS, build_mesh
from softarm.estimator.mesh import ElementSurface, Mesh
from softarm.estimator.reference_elements import CORNERS
from softarm.estimator.specimen import Specimen

SAME_LEVEL_M = 1e-6
"""Nodes of a swept body lie in levels; those of one level differ by rounding only."""
COLOURS = ("#1b7f79", "#d95f02", "#7570b3", "#e7298a", "#66a61e", "#a6761d")


def draw_specimen(specimen: Specimen) -> Figure:
    """Draw the body from the side with its chambers, and the cross-section of every segment.

    Args:
        specimen: The arm; the page shows it hanging, in millimetres.
    """
    # Twice as fine, so that round walls look round and the middle of a segment is a level with all its nodes.
    mesh = build_mesh(specimen, replace(DEFAULTS[specimen.geometry.kind], refinement=2))
    count = max(len(specimen.segments), 1)
    figure = blank(5.0 + 3.2 * count, 6.0)
    grid = figure.add_gridspec(1, 1 + count, width_ratios=(1.4, *([1.0] * count)))
    _draw_body(figure.add_subplot(grid[0], projection="3d"), specimen, mesh)
    for column, segment in enumerate(specimen.segments, start=1):
        axes = figure.add_subplot(grid[column])
        _draw_cross_section(axes, mesh, 0.5 * (segment.from_m + segment.to_m))
        axes.set_title(f"{segment.name}, halfway", fontsize=9)
    figure.suptitle(f"{specimen.name}, at rest [mm]", fontsize=11)
    return figure


def _draw_body(axes: Any, specimen: Specimen, mesh: Mesh) -> None:
    points = mesh.points * MM_PER_M
    for name, surface in mesh.surfaces.items():
        facets = points[surface.facets[:, : CORNERS[surface.kind]]]
        outer = name == "outer"
        style = (
            {"facecolor": "#b8cbe0", "alpha": 0.15} if outer else {"facecolor": _colour(name), "alpha": 0.5}
        )
        axes.add_collection3d(Poly3DCollection(facets, edgecolor="#5b7594", linewidths=0.1, **style))
    low, high = points.min(axis=0), points.max(axis=0)
    half = 0.6 * float((high - low).max())
    middle = 0.5 * (low + high)
    axes.set(xlim=(-half, half), ylim=(-half, half), zlim=(middle[2] + half, middle[2] - half))
    axes.set_box_aspect((1, 1, 1), zoom=1.25)
    axes.view_init(10.0, -60.0)
    axes.tick_params(labelsize=6)
    for section in specimen.sections:
        axes.text(
            high[0] * 1.4, 0.0, MM_PER_M * 0.5 * (section.from_m + section.to_m), section.name, fontsize=8
        )


def _draw_cross_section(axes: Axes, mesh: Mesh, height: float) -> None:
    for name, surface in sorted(mesh.surfaces.items(), key=lambda one: one[0] != "outer"):  # the body first
        points = MM_PER_M * _ring(mesh, surface, height)
        if len(points):
            colour = "#b8cbe0" if name == "outer" else _colour(name)
            axes.fill(points[:, 0], points[:, 1], facecolor=colour, edgecolor="#333333", linewidth=0.8)
            if name != "outer":
                middle = points.mean(axis=0)
                axes.text(middle[0], middle[1], name.removeprefix("chamber_"), ha="center", va="center")
    axes.set_aspect("equal")
    axes.tick_params(labelsize=7)
    axes.axhline(0.0, color="#cccccc", linewidth=0.5, zorder=0)
    axes.axvline(0.0, color="#cccccc", linewidth=0.5, zorder=0)


def _ring(mesh: Mesh, surface: ElementSurface, height: float) -> Floats:
    """Return the outline of a surface at the level nearest to a height, empty where it does not reach there.

    Nodes are ordered around their middle, from which every outline of the parametric bodies is seen whole.
    """
    nodes = mesh.points[np.unique(surface.facets)]
    levels = nodes[:, 2]
    if not levels.min() <= height <= levels.max():
        return nodes[:0]
    nearest = levels[np.argmin(np.abs(levels - height))]
    ring = nodes[np.abs(levels - nearest) < SAME_LEVEL_M]
    away = ring - ring.mean(axis=0)
    return np.asarray(ring[np.argsort(np.arctan2(away[:, 1], away[:, 0]))])


def _colour(name: str) -> str:
    digits = "".join(character for character in name if character.isdigit())
    return COLOURS[int(digits or 0) % len(COLOURS)]
