"""Checks of a recording's values: what cannot be true is refused with its row, its column and a cure."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.recordings.columns import TIME, check_names

LARGEST_PRESSURE = 2e6  # Pa; no chamber of silicone holds 20 bar, so it is another unit
SMALLEST_PRESSURE_RANGE = 1e3  # Pa; a run at less than 10 mbar moves nothing, so it is kPa or mbar
LARGEST_LENGTH = 50.0  # m; a motion-capture volume
LARGEST_BEND = 2 * np.pi  # rad
QUATERNION_TOLERANCE = 0.02
LINE_OF_FIRST_ROW = 2  # in a CSV file, after the header


def checked_recording(
    name: str,
    source: str,
    columns: Mapping[str, Floats],
    info: Mapping[str, Any],
    *,
    units_checked: bool = True,
) -> Recording:
    """Build a recording from a table, time among its columns.

    Args:
        name: What reports call it.
        source: The file, for messages.
        columns: Column name to values, each of shape (samples,); NaN is a lost reading.
        info: Facts of the run from ``recording.toml``.
        units_checked: Whether values that only another unit explains are refused.

    Raises:
        InputError: Names the file, the column, the row and the cure.
    """
    check_names(source, list(columns))
    time = columns[TIME]
    if not len(time):
        raise InputError(source, "holds no samples", "record again, or give the file that holds the data")
    _check_time(source, time)
    values = {column: samples for column, samples in columns.items() if column != TIME}
    for column, samples in values.items():
        _check_finite(source, column, samples)
        if units_checked:
            _check_size(source, column, samples)
    if not any(np.isfinite(samples).any() for samples in values.values()):
        raise InputError(source, "every cell is empty", "give a recording with readings in it")
    recording = Recording(name, time, values, info)
    if units_checked:
        _check_pressure_unit(source, recording)
    _check_quaternions(source, recording, lost=not units_checked)
    return recording


def row(source: str, index: int) -> str:
    """Name the place of a sample in its file."""
    line = f" (line {index + LINE_OF_FIRST_ROW})" if source.endswith(".csv") else ""
    return f"row {index + 1}{line}"


def _check_time(source: str, time: Floats) -> None:
    where = f"{source}, column {TIME}"
    bad = np.flatnonzero(~np.isfinite(time))
    if bad.size:
        raise InputError(
            f"{where}, {row(source, bad[0])}",
            "the time is empty or not a number",
            "give every row its time in seconds, or remove the row",
        )
    steps = np.diff(time)
    bad = np.flatnonzero(steps <= 0)
    if bad.size:
        at = int(bad[0]) + 1
        what = (
            f"repeats {time[at]:.9g} s"
            if steps[at - 1] == 0
            else f"goes back from {time[at - 1]:.9g} to {time[at]:.9g} s"
        )
        raise InputError(
            f"{where}, {row(source, at)}",
            f"time {what}",
            "time must rise from row to row; sort the rows, remove the repeated ones",
        )


def _check_finite(source: str, column: str, samples: Floats) -> None:
    bad = np.flatnonzero(np.isinf(samples))
    if bad.size:
        raise InputError(
            f"{source}, column {column}, {row(source, bad[0])}",
            "the value is infinite",
            "leave the cell empty where a reading was lost",
        )


def _check_size(source: str, column: str, samples: Floats) -> None:
    """Refuse lengths, angles and pressures that only another unit explains."""
    if column.startswith("estimate_"):
        return
    limit, si, cure = {
        "_pa": (LARGEST_PRESSURE, "Pa", "gauge pressure in Pa is expected; convert it"),
        "_m": (LARGEST_LENGTH, "m", "lengths are in m; multiply millimetres by 0.001"),
        "rad": (LARGEST_BEND, "rad", "angles are in rad; multiply degrees by 0.01745329"),
    }.get(column[-3:] if column.endswith(("_pa", "rad")) else column[-2:], (np.inf, "", ""))
    sizes = np.abs(samples)
    bad = np.flatnonzero(sizes > limit)
    if bad.size:
        raise InputError(
            f"{source}, column {column}, {row(source, bad[0])}", f"{samples[bad[0]]:.6g} cannot be {si}", cure
        )


def _check_pressure_unit(source: str, recording: Recording) -> None:
    """Refuse pressures that move like an actuated arm's but stay below 10 mbar: kPa or mbar written as Pa.

    Noise about zero of an arm that is not pressurised is no such thing: its steps from sample to sample are
    as large as its spread.
    """
    if str(recording.info.get("pressure_unit", "")).lower() == "pa":
        return
    names = [f"pressure_{cmd}{k}_pa" for k in recording.chambers for cmd in ("", "cmd_")]
    present = {name: recording.columns[name] for name in names if name in recording.columns}
    largest = max((float(np.nanmax(np.abs(v), initial=0.0)) for v in present.values()), default=0.0)
    if not 1.0 < largest < SMALLEST_PRESSURE_RANGE:
        return
    for name, samples in present.items():
        values = samples[np.isfinite(samples)]
        if values.size > 2 and np.ptp(values) > 1.0 and np.std(np.diff(values)) < 0.5 * np.std(values):
            raise InputError(
                f"{source}, column {name}",
                f"the pressures reach only {largest:.4g}, which cannot be Pa of an actuated arm",
                "multiply by 1000 if kPa, by 100 if mbar; if Pa, set pressure_unit = 'Pa' in recording.toml",
            )


def _check_quaternions(source: str, recording: Recording, *, lost: bool) -> None:
    """Refuse quaternions that are not of unit length.

    Four equal numbers, such as zeros, are refused only where they may not stand for a lost body.
    """
    for section in recording.frames:
        quaternions = recording.pose(section)[:, 3:]
        norms = np.linalg.norm(quaternions, axis=1)
        alike = (quaternions == quaternions[:, :1]).all(axis=1)
        bad = np.flatnonzero((np.abs(norms - 1.0) > QUATERNION_TOLERANCE) & ~(lost & alike))
        if bad.size:
            raise InputError(
                f"{source}, columns frame_{section}_qw ... qz, {row(source, bad[0])}",
                f"the quaternion has norm {norms[bad[0]]:.4g}, not 1",
                "give unit quaternions (w, x, y, z), or leave the cells empty",
            )
