"""The arm in space at a few instants: its surface, its sections' axes, the forces on it."""

from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from softarm.analysis.offline.track import State, Track
from softarm.analysis.plots.figures import MM_PER_M, blank
from softarm.estimator.arrays import Floats

FORCE_LENGTH = 0.25  # of the arm's length, for the largest force shown
VIEW = (12.0, -60.0)


def draw_arms(track: Track[State], title: str, surface: Callable[[State], Floats] | None) -> Figure:
    """Draw the arm at the samples whose state was kept, hanging with gravity downwards on the page."""
    count = max(len(track.shown), 1)
    columns = min(count, 3)
    rows = -(-count // columns)
    figure = blank(3.6 * columns, 4.4 * rows)
    extent = _extent(track)
    largest = float(np.nanmax(np.abs(track.forces))) if track.forces.size else 0.0
    for number, (index, state) in enumerate(track.shown, start=1):
        axes = figure.add_subplot(rows, columns, number, projection="3d")
        if surface is not None:
            polygons = Poly3DCollection(
                surface(state) * MM_PER_M, facecolor="#b8cbe0", edgecolor="#5b7594", linewidths=0.15
            )
            axes.add_collection3d(polygons)
        positions = track.frames.positions[index] * MM_PER_M
        axes.plot(*positions.T, "o-", color="black", markersize=2, linewidth=0.8)
        _draw_axes(axes, positions, track.frames.rotations[index], extent)
        _draw_forces(axes, track, index, largest, extent)
        axes.set(xlim=(-extent, extent), ylim=(-extent, extent), zlim=(2 * extent, 0))
        axes.set_box_aspect((1, 1, 1), zoom=1.05)
        axes.view_init(*VIEW)
        axes.tick_params(labelsize=6)
        axes.set_title(f"{track.run.time[index]:.2f} s", fontsize=9)
    figure.suptitle(f"{title}: estimated shape [mm]; red: forces, largest {largest:.3g} N", fontsize=11)
    return figure


def _extent(track: Track[State]) -> float:
    """Return half the edge of a cube that holds every pose [mm]."""
    reach = float(np.nanmax(np.abs(track.frames.positions))) * MM_PER_M
    return 0.55 * reach + 5.0


def _draw_axes(axes: object, positions: Floats, rotations: Floats, extent: float) -> None:
    for column, colour in enumerate(("tab:red", "tab:green", "tab:blue")):
        ends = 0.12 * extent * rotations[:, :, column]
        axes.quiver(*positions.T, *ends.T, color=colour, linewidth=0.8)  # type: ignore[attr-defined]


def _draw_forces(axes: object, track: Track[State], index: int, largest: float, extent: float) -> None:
    if largest == 0.0:
        return
    for number, load in enumerate(track.loads):
        if load.section is None or load.kind != "force":
            continue
        start = track.frames.positions[index, track.sections.index(load.section)] * MM_PER_M
        scale = 4 * FORCE_LENGTH * extent * track.forces[index, number] / largest
        arrow = np.array(load.direction) * scale
        axes.quiver(*start, *arrow, color="crimson", linewidth=1.6)  # type: ignore[attr-defined]
