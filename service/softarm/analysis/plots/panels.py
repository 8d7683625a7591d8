"""What a recording's streams look like over time: one panel per kind of stream, in units for people."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from softarm.analysis.plots.figures import KPA_PER_PA, MM_PER_M
from softarm.estimator.arrays import Floats
from softarm.estimator.recording import Recording
from softarm.estimator.rotations import from_quaternions, log


@dataclass(frozen=True)
class PlotLine:
    """One curve.

    Args:
        label: What it is.
        values: In the panel's unit, shape (samples,).
        dashed: Whether it is a commanded pressure and not a reading.
    """

    label: str
    values: Floats
    dashed: bool = False


@dataclass(frozen=True)
class PlotPanel:
    """One set of axes.

    Args:
        title: Kind of stream.
        unit: Unit of its curves.
        lines: The curves.
        moves: Whether it shows motion, so that a spectrum of it shows vibration.
    """

    title: str
    unit: str
    lines: tuple[PlotLine, ...]
    moves: bool = True


def panels(recording: Recording) -> tuple[PlotPanel, ...]:
    """Arrange all streams of a recording in panels."""
    return tuple(
        panel
        for panel in (
            *_pressures(recording),
            *_bends(recording),
            *_poses(recording),
            *_markers(recording),
            *_gauges(recording),
            *_estimates(recording),
        )
        if panel.lines
    )


def _pressures(recording: Recording) -> Iterator[PlotPanel]:
    lines = []
    for chamber in recording.chambers:
        for name, label, dashed in (
            (f"pressure_{chamber}_pa", f"chamber {chamber}", False),
            (f"pressure_cmd_{chamber}_pa", f"chamber {chamber} commanded", True),
        ):
            if name in recording.columns:
                lines.append(PlotLine(label, recording.columns[name] * KPA_PER_PA, dashed))
    yield PlotPanel("Pressure, gauge", "kPa", tuple(lines), moves=False)


def _bends(recording: Recording) -> Iterator[PlotPanel]:
    for section in recording.bends:
        angles = np.degrees(recording.bend(section))
        yield PlotPanel(
            f"Bend of {section}", "degrees", (PlotLine("x", angles[:, 0]), PlotLine("y", angles[:, 1]))
        )


def _poses(recording: Recording) -> Iterator[PlotPanel]:
    for section in recording.frames:
        pose = recording.pose(section)
        moved = (pose[:, :3] - _first(pose[:, :3])) * MM_PER_M
        vectors = _rotation_vectors(pose[:, 3:])
        yield PlotPanel(f"Position of {section}, from the first sample", "mm", _axes(moved))
        yield PlotPanel(f"Rotation of {section}, from the first sample", "degrees", _axes(vectors))


def _rotation_vectors(quaternions: Floats) -> Floats:
    """Return rotation vectors from the first orientation [degrees], shape (samples, 3)."""
    vectors = np.full((len(quaternions), 3), np.nan)
    valid = np.isfinite(quaternions).all(axis=1)
    if valid.any():
        rotations = from_quaternions(quaternions[valid])
        vectors[valid] = np.degrees(log(rotations[0].T @ rotations))
    return vectors


def _markers(recording: Recording) -> Iterator[PlotPanel]:
    for axis, letter in enumerate("xyz"):
        lines = []
        for name in recording.markers:
            positions = recording.marker(name)
            lines.append(PlotLine(name, (positions[:, axis] - _first(positions)[axis]) * MM_PER_M))
        yield PlotPanel(f"Markers along {letter}, from the first sample", "mm", tuple(lines))


def _gauges(recording: Recording) -> Iterator[PlotPanel]:
    lines = tuple(PlotLine(name, recording.gauge(name)) for name in recording.gauges)
    yield PlotPanel("Force gauges, pull positive", "N", lines, moves=False)


def _estimates(recording: Recording) -> Iterator[PlotPanel]:
    forces = recording.members(r"estimate_force_(.+?)(?<!_std)_n")
    lines = tuple(PlotLine(name, recording.columns[f"estimate_force_{name}_n"]) for name in forces)
    yield PlotPanel("Estimated forces", "N", lines, moves=False)


def _axes(values: Floats) -> tuple[PlotLine, ...]:
    return tuple(PlotLine(letter, values[:, axis]) for axis, letter in enumerate("xyz"))


def _first(values: Floats) -> Floats:
    """Return the first reading that was not lost, shape (3,)."""
    valid = np.flatnonzero(np.isfinite(values).all(axis=1))
    first: Floats = values[valid[0]] if valid.size else np.full(values.shape[1], np.nan)
    return first
