"""Plots of a recording: its streams over time, the spectra of its motion, the paths of what moves."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import welch

from softarm.analysis.plots.figures import MM_PER_M, blank, label, save, stacked
from softarm.analysis.plots.panels import PlotPanel, panels
from softarm.estimator.arrays import Floats
from softarm.estimator.recording import Recording

SHORTEST_SPECTRUM = 64  # samples
GAP_STEPS = 3.0
"""Readings further apart than so many usual steps are drawn with a break between them."""


def plot_recording(
    recording: Recording, folder: Path, advance: Callable[[float], None] = lambda _: None
) -> tuple[Path, ...]:
    """Draw all plots that a recording has data for.

    Args:
        recording: What to plot.
        folder: Where the PNG files go.
        advance: Called with 1 after each figure.

    Returns:
        The files written.
    """
    written = []
    for name, draw in (("streams", draw_streams), ("spectra", draw_spectra), ("paths", draw_paths)):
        figure = draw(recording)
        if figure is not None:
            written.append(save(figure, folder / f"{name}.png"))
        advance(1)
    return tuple(written)


def draw_streams(recording: Recording) -> Figure:
    """Draw all streams over time."""
    shown = panels(recording)
    figure, all_axes = stacked(len(shown))
    for axes, panel in zip(all_axes, shown, strict=True):
        for number, line in enumerate(panel.lines):
            dashed = line.dashed
            axes.plot(
                *with_gaps(recording.time, line.values),
                "--" if dashed else "-",
                color=f"C{(number // 2 if _paired(panel) else number) % 10}",
                linewidth=0.8,
                alpha=0.6 if dashed else 1.0,
                label=line.label,
            )
        label(axes, panel.title, panel.unit)
    all_axes[-1].set_xlabel("time [s]", fontsize=8)
    figure.suptitle(recording.name, fontsize=11)
    return figure


def _paired(panel: PlotPanel) -> bool:
    """Return whether each measured curve is followed by its commanded one, so that both share a colour."""
    return len(panel.lines) > 1 and [line.dashed for line in panel.lines[:2]] == [False, True]


def draw_spectra(recording: Recording) -> Figure | None:
    """Draw the amplitude spectra of all that moves; ``None`` where nothing does, or not for long enough."""
    moving = [panel for panel in panels(recording) if panel.moves]
    if not moving or len(recording.time) < SHORTEST_SPECTRUM:
        return None
    figure, all_axes = stacked(len(moving))
    for axes, panel in zip(all_axes, moving, strict=True):
        for line in panel.lines:
            frequencies, density = amplitude_spectrum(recording.time, line.values)
            axes.plot(frequencies, density, linewidth=0.8, label=line.label)
            axes.set_yscale("log" if (density > 0).any() else axes.get_yscale())
        label(axes, panel.title, f"{panel.unit}/√Hz")
    all_axes[-1].set_xlabel("frequency [Hz]", fontsize=8)
    figure.suptitle(f"{recording.name}: amplitude spectral density", fontsize=11)
    return figure


def with_gaps(time: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return the readings of one sensor, with a break wherever some of its own are missing.

    The rows of a recording are the times of all its streams: a row without a reading of this sensor is no
    lost reading of it.

    Args:
        time: Seconds, shape (samples,).
        values: NaN in rows without a reading, shape (samples,).

    Returns:
        Times and values of the readings; NaN in the middle of each stretch of more than three usual steps.
    """
    valid = np.isfinite(values)
    times, readings = time[valid], values[valid]
    steps = np.diff(times)
    if not len(steps):
        return times, readings
    breaks = np.flatnonzero(steps > GAP_STEPS * np.median(steps)) + 1
    middles = 0.5 * (times[breaks - 1] + times[breaks])
    return np.insert(times, breaks, middles), np.insert(readings, breaks, np.nan)


def amplitude_spectrum(time: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Estimate an amplitude spectral density by Welch's method, gaps bridged by straight lines.

    The analysed grid has the sensor's own rate, the inverse of its usual step.

    Args:
        time: Seconds, shape (samples,).
        values: NaN in rows without a reading, shape (samples,).

    Returns:
        Frequencies up to half the sensor's rate [Hz], and densities [unit/sqrt(Hz)].
    """
    valid = np.isfinite(values)
    if valid.sum() < SHORTEST_SPECTRUM:
        return np.empty(0), np.empty(0)
    times = time[valid]
    rate = 1.0 / float(np.median(np.diff(times)))
    even = np.arange(times[0], times[-1], 1.0 / rate)
    bridged = np.interp(even, times, values[valid])
    frequencies, density = welch(bridged, rate, nperseg=min(len(even), 1024), detrend="linear")
    return frequencies[1:], np.sqrt(density[1:])


def draw_paths(recording: Recording) -> Figure | None:
    """Draw the paths of markers and section frames in space and of bends in their plane."""
    spatial = {name: recording.marker(name) for name in recording.markers}
    spatial |= {section: recording.pose(section)[:, :3] for section in recording.frames}
    planar = {section: np.degrees(recording.bend(section)) for section in recording.bends}
    count = bool(spatial) + len(planar)
    if not count:
        return None
    figure = blank(5.2 * count, 5.0)
    for number, (section, bend) in enumerate(planar.items(), start=1):
        axes = figure.add_subplot(1, count, number)
        axes.plot(bend[:, 0], bend[:, 1], linewidth=0.5)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x [degrees]", fontsize=8)
        label(axes, f"Bend of {section}", "y [degrees]")
    if spatial:
        axes = figure.add_subplot(1, count, count, projection="3d")
        for name, positions in spatial.items():
            axes.plot(*(positions * MM_PER_M).T, linewidth=0.8, label=name)
        axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
        axes.set_aspect("equal")
        axes.set_box_aspect(None, zoom=0.85)
        axes.tick_params(labelsize=7)
        axes.legend(fontsize=7, frameon=False)
    figure.suptitle(f"{recording.name}: paths", fontsize=11)
    return figure
