"""Estimates over time as a recording and as tables."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from softarm.analysis.offline.track import STATUSES, State, Track
from softarm.estimator.arrays import Floats
from softarm.estimator.recording import POSE_SUFFIXES, Recording
from softarm.estimator.rotations import to_quaternions
from softarm.estimator.series import nearest

Cells = dict[str, str | int | float | bool | None]
AXES = "xyz"
SHOWN = {"m": (1e3, "mm"), "rad": (float(np.degrees(1.0)), "degrees")}
"""Factor and unit in which people read what is in SI units."""


def as_recording(track: Track[State], source: Recording, info: Mapping[str, Any]) -> Recording:
    """Put estimates beside the readings that they rest on, at the times of the estimates.

    Columns: ``estimate_force_<load>_n`` and ``..._std_n`` (moments ``estimate_moment_<load>_nm``),
    ``estimate_frame_<section>_<x_m ... qz>`` and ``..._<x>_std_m``, ``..._<x>_std_rad``,
    ``estimate_pressure_<k>_pa``, ``estimate_misfit``, ``estimate_freedom`` and ``estimate_status`` (0
    converged, 1 iterations exhausted, 2 diverged).

    Args:
        track: The estimates.
        source: The recording that was estimated.
        info: Further entries of ``recording.toml``.
    """
    wanted = track.run.time
    reach = 0.51 * float(np.median(np.diff(wanted))) if len(wanted) > 1 else np.inf
    columns: dict[str, Floats] = {
        name: nearest(wanted, source.time, values, reach)
        for name, values in source.columns.items()
        if not name.startswith("estimate_")
    }
    columns |= _forces(track) | _frames(track)
    for chamber in range(track.pressures.shape[1]):
        columns[f"estimate_pressure_{chamber}_pa"] = track.pressures[:, chamber]
    columns["estimate_misfit"] = track.misfit
    columns["estimate_freedom"] = track.freedom
    columns["estimate_status"] = track.status.astype(np.float64)
    return Recording(source.name, track.run.time, columns, {**source.info, **info})


def force_rows(track: Track[State]) -> list[Cells]:
    """Summarise each load over time: mean, spread over time, largest, and the estimate's own deviation."""
    rows: list[Cells] = []
    for index, load in enumerate(track.loads):
        values = track.forces[:, index]
        rows.append(
            {
                "load": load.name,
                "unit": "N" if load.kind == "force" else "N m",
                "mean": float(np.nanmean(values)),
                "std_over_time": float(np.nanstd(values)),
                "largest": float(values[np.nanargmax(np.abs(values))]),
                "std_of_estimate": float(np.nanmedian(track.force_std[:, index])),
            }
        )
    return rows


@dataclass(frozen=True)
class Residuals:
    """Residuals of a sensor in one unit.

    Args:
        sensor: Name of the sensor.
        unit: ``mm`` or ``degrees``.
        values: Measured minus estimated, shape (samples, components).
        noise: Standard deviation of each component, shape (components,).
    """

    sensor: str
    unit: str
    values: Floats
    noise: Floats


def residuals_by_unit(track: Track[State]) -> Iterator[Residuals]:
    """Yield the residuals of each sensor, lengths apart from angles."""
    for measurement in track.run.suite.measurements:
        columns = track.run.suite.slices[measurement.name]
        for unit in dict.fromkeys(measurement.units):
            alike = np.array([one == unit for one in measurement.units])
            scale, shown = SHOWN[unit]
            values, noise = track.residuals[:, columns][:, alike], track.run.suite.noise[columns][alike]
            yield Residuals(measurement.name, shown, scale * values, scale * noise)


def sensor_rows(track: Track[State]) -> list[Cells]:
    """Summarise the residuals of each sensor, beside its noise."""
    rows: list[Cells] = []
    for part in residuals_by_unit(track):
        valid = np.isfinite(part.values).all(axis=1)
        rows.append(
            {
                "sensor": part.sensor,
                "samples": int(valid.sum()),
                "residual_rms": float(np.sqrt((part.values[valid] ** 2).mean())) if valid.any() else None,
                "noise": float(np.sqrt((part.noise**2).mean())),
                "unit": part.unit,
            }
        )
    return rows


def section_rows(track: Track[State]) -> list[Cells]:
    """Summarise each section's position over time [mm] and its deviation."""
    rows: list[Cells] = []
    for index, section in enumerate(track.sections):
        positions = track.frames.positions[:, index] * 1e3
        row: Cells = {"section": section}
        for axis, letter in enumerate(AXES):
            row[f"{letter}_from_mm"] = float(np.nanmin(positions[:, axis]))
            row[f"{letter}_to_mm"] = float(np.nanmax(positions[:, axis]))
        row["std_mm"] = float(np.nanmedian(track.frame_std[:, index, :3].max(axis=1)) * 1e3)
        row["std_degrees"] = float(np.degrees(np.nanmedian(track.frame_std[:, index, 3:].max(axis=1))))
        rows.append(row)
    return rows


def status_counts(track: Track[State]) -> dict[str, int]:
    """Count how the searches ended."""
    return {name: int((track.status == number).sum()) for number, name in enumerate(STATUSES)}


def _forces(track: Track[State]) -> dict[str, Floats]:
    columns = {}
    for index, load in enumerate(track.loads):
        kind, unit = ("force", "n") if load.kind == "force" else ("moment", "nm")
        columns[f"estimate_{kind}_{load.name}_{unit}"] = track.forces[:, index]
        columns[f"estimate_{kind}_{load.name}_std_{unit}"] = track.force_std[:, index]
    return columns


def _frames(track: Track[State]) -> dict[str, Floats]:
    columns = {}
    for index, section in enumerate(track.sections):
        rotations = track.frames.rotations[:, index]
        good = np.isfinite(rotations).all(axis=(1, 2))
        pose = np.full((len(rotations), 7), np.nan)
        pose[good, :3] = track.frames.positions[good, index]
        pose[good, 3:] = to_quaternions(rotations[good])
        for number, suffix in enumerate(POSE_SUFFIXES):
            columns[f"estimate_frame_{section}_{suffix}"] = pose[:, number]
        for number, unit in enumerate(("m", "m", "m", "rad", "rad", "rad")):
            name = f"estimate_frame_{section}_{AXES[number % 3]}_std_{unit}"
            columns[name] = track.frame_std[:, index, number]
    return columns
