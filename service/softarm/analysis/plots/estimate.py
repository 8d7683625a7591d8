"""Plots of estimates over time: forces with their uncertainty, sections, residuals, and the arm itself."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from softarm.analysis.offline.result import residuals_by_unit
from softarm.analysis.offline.track import State, Track
from softarm.analysis.plots.arm import draw_arms
from softarm.analysis.plots.figures import MM_PER_M, label, save, stacked
from softarm.estimator.arrays import Floats


def plot_track(
    track: Track[State], title: str, folder: Path, surface: Callable[[State], Floats] | None
) -> tuple[Path, ...]:
    """Draw all plots of some estimates.

    Args:
        track: The estimates.
        title: What they are of.
        folder: Where the PNG files go.
        surface: Corners of the triangles of the body's surface [m] in a state of the model, shape
            (triangles, 3, 3); None draws none.

    Returns:
        The files written.
    """
    return (
        save(draw_forces(track, title), folder / "forces.png"),
        save(draw_sections(track, title), folder / "sections.png"),
        save(draw_residuals(track, title), folder / "residuals.png"),
        save(draw_arms(track, title, surface), folder / "arm.png"),
    )


def draw_forces(track: Track[State], title: str) -> Figure:
    """Draw each load over time with a band of two standard deviations, and the misfit."""
    figure, all_axes = stacked(len(track.loads) + 1)
    for index, (axes, load) in enumerate(zip(all_axes, track.loads, strict=False)):
        values, deviation = track.forces[:, index], track.force_std[:, index]
        axes.fill_between(
            track.run.time, values - 2 * deviation, values + 2 * deviation, alpha=0.25, linewidth=0
        )
        axes.plot(track.run.time, values, linewidth=0.9)
        axes.axhline(0.0, color="black", linewidth=0.5)
        label(axes, f"{load.name}, band: two standard deviations", "N" if load.kind == "force" else "N m")
    axes = all_axes[-1]
    axes.plot(track.run.time, track.misfit, linewidth=0.9, label="weighted squares that the readings keep")
    axes.plot(track.run.time, track.freedom, linewidth=0.9, label="expected where the model is right")
    axes.set_yscale("symlog", linthresh=1.0)
    label(axes, "Misfit", "-")
    axes.set_xlabel("time [s]", fontsize=8)
    figure.suptitle(f"{title}: external loads", fontsize=11)
    return figure


def draw_sections(track: Track[State], title: str) -> Figure:
    """Draw the position and the tilt of each section that moves over time."""
    moving = [
        index
        for index in range(len(track.sections))
        if np.nanmax(np.nanstd(track.frames.positions[:, index], axis=0)) > 0
    ]
    figure, all_axes = stacked(max(2 * len(moving), 1))
    for place, index in enumerate(moving):
        name = track.sections[index]
        for axis, letter in enumerate("xyz"):
            values = track.frames.positions[:, index, axis] * MM_PER_M
            deviation = track.frame_std[:, index, axis] * MM_PER_M
            all_axes[2 * place].plot(track.run.time, values, linewidth=0.9, label=letter)
            all_axes[2 * place].fill_between(
                track.run.time, values - 2 * deviation, values + 2 * deviation, alpha=0.25, linewidth=0
            )
        label(all_axes[2 * place], f"Position of {name} in the base frame", "mm")
        axis_z = track.frames.rotations[:, index, :, 2]
        tilt = np.degrees(np.arctan2(np.linalg.norm(axis_z[:, :2], axis=1), axis_z[:, 2]))
        all_axes[2 * place + 1].plot(track.run.time, tilt, linewidth=0.9)
        label(all_axes[2 * place + 1], f"Tilt of {name} from the rest axis", "degrees")
    all_axes[-1].set_xlabel("time [s]", fontsize=8)
    figure.suptitle(f"{title}: sections", fontsize=11)
    return figure


def draw_residuals(track: Track[State], title: str) -> Figure:
    """Draw the residuals of each sensor, with its noise as a band."""
    parts = tuple(residuals_by_unit(track))
    figure, all_axes = stacked(len(parts))
    for axes, residuals in zip(all_axes, parts, strict=True):
        band = 2 * residuals.noise.max()
        axes.axhspan(-band, band, alpha=0.15, linewidth=0)
        for number, column in enumerate(residuals.values.T):
            axes.plot(track.run.time, column, linewidth=0.7, label=str(number))
        label(axes, f"{residuals.sensor}: measured minus estimated, band: twice the noise", residuals.unit)
    all_axes[-1].set_xlabel("time [s]", fontsize=8)
    figure.suptitle(f"{title}: residuals", fontsize=11)
    return figure
