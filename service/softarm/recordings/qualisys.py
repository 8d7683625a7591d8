"""Qualisys motion exports as text (``.tsv``): markers in 3D files, rigid bodies in 6D files.

Format: "Motion data (.tsv)" and "6DOF data" in the manual of Qualisys Track Manager. Lengths are millimetres;
a 6D body takes 16 cells: X Y Z, roll pitch yaw [deg], residual, and the rotation matrix column by column.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.recording import MARKER_SUFFIXES, POSE_SUFFIXES
from softarm.estimator.rotations import to_quaternions
from softarm.recordings.columns import TIME
from softarm.recordings.mapping import MILLIMETRE, mapped_names

CELLS_OF_MARKER = 3
CELLS_OF_BODY = 16
LOST = ("", "NULL", "NaN", "nan", "-")


def read_tsv(path: Path, info: Mapping[str, Any]) -> dict[str, Floats]:
    """Read the markers or the rigid bodies of an export, in metres.

    Args:
        path: The export, with its header.
        info: Its column map, tables ``markers`` and ``bodies``.

    Raises:
        InputError: The export has no header, or its rows do not fit it.
    """
    header, lines, first = _split(path)
    kind = (header.get("DATA_INCLUDED") or [""])[0]
    if kind not in ("3D", "6D"):
        raise InputError(
            f"{path}, DATA_INCLUDED",
            f"is {kind or 'missing'}",
            "export 3D or 6D data with the header included",
        )
    word, cells = ("MARKER_NAMES", CELLS_OF_MARKER) if kind == "3D" else ("BODY_NAMES", CELLS_OF_BODY)
    labels = [label for label in header.get(word, []) if label]
    if not labels:
        raise InputError(f"{path}, {word}", "names nothing", "label the trajectories before the export")
    time, values = _parse(path, header, lines, first, cells * len(labels))
    blocks = values.reshape(len(time), len(labels), cells)
    columns = {TIME: time}
    read = _marker if kind == "3D" else _body
    table = "markers" if kind == "3D" else "bodies"
    for number, name in enumerate(mapped_names(str(path), labels, info, table)):
        if name is not None:
            columns |= read(name, blocks[:, number])
    return columns


def _split(path: Path) -> tuple[dict[str, list[str]], list[str], int]:
    """Separate header and data rows; also the number of the first data line."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError:
        # Exports from Windows may hold umlauts of an older code page; every byte is valid in this one.
        lines = path.read_text(encoding="latin-1").splitlines()
    header: dict[str, list[str]] = {}
    for number, line in enumerate(lines):
        cells = [cell.strip() for cell in line.split("\t")]
        if _is_number(cells[0]):
            return header, lines[number:], number + 1
        header[cells[0]] = cells[1:]
    return header, [], len(lines)


def _parse(
    path: Path, header: Mapping[str, list[str]], lines: list[str], first: int, wanted: int
) -> tuple[Floats, Floats]:
    """Return the times [s], shape (samples,), and the cells behind them, shape (samples, wanted)."""
    rows = []
    for number, line in enumerate(lines, start=first):
        if line.strip():
            rows.append([_value(path, number, cell.strip()) for cell in line.rstrip("\r\n").split("\t")])
    if not rows:
        raise InputError(str(path), "holds no samples", "export the measured range")
    width = max(len(row) for row in rows)
    table = np.array([row + [np.nan] * (width - len(row)) for row in rows])
    timed = any("Time" in (word, *cells[:1]) for word, cells in header.items())
    leading = _leading(path, header, table, wanted)
    frequency = (header.get("FREQUENCY") or [""])[0]
    if timed and leading:
        time = table[:, leading - 1]
    elif _is_number(frequency) and float(frequency) > 0:
        time = np.arange(len(table)) / float(frequency)
    else:
        raise InputError(f"{path}, FREQUENCY", f"is {frequency or 'missing'}", "export with the Time column")
    return time, table[:, leading : leading + wanted]


def _leading(path: Path, header: Mapping[str, list[str]], table: Floats, wanted: int) -> int:
    """Count the cells before the first value: frame number, time, both or none."""
    words = [[word, *cells] for word, cells in header.items()]
    leading = max((len([w for w in line[:2] if w in ("Frame", "Time")]) for line in words), default=0)
    if table.shape[1] < leading + wanted:
        raise InputError(
            f"{path}, first data row",
            f"has {table.shape[1]} cells, the header names {leading + wanted}",
            "export again with the header that belongs to the data",
        )
    return leading


def _marker(name: str, block: Floats) -> dict[str, Floats]:
    """Parse a marker's three cells; three zeros are a lost marker."""
    lost = (block == 0).all(axis=1)
    positions = np.where(lost[:, None], np.nan, block * MILLIMETRE)
    return {f"marker_{name}_{suffix}": positions[:, i].copy() for i, suffix in enumerate(MARKER_SUFFIXES)}


def _body(name: str, block: Floats) -> dict[str, Floats]:
    """Parse a body's sixteen cells; a body without a rotation is lost."""
    # The export lists a matrix column by column.
    matrices = block[:, 7:16].reshape(-1, 3, 3).swapaxes(1, 2)
    good = np.isfinite(block).all(axis=1) & (np.abs(np.linalg.det(np.nan_to_num(matrices)) - 1.0) < 0.01)
    pose = np.full((len(block), 7), np.nan)
    pose[good, :3] = block[good, :3] * MILLIMETRE
    pose[good, 3:] = to_quaternions(matrices[good])
    return {f"frame_{name}_{suffix}": pose[:, i].copy() for i, suffix in enumerate(POSE_SUFFIXES)}


def _value(path: Path, line: int, cell: str) -> float:
    if cell in LOST:
        return np.nan
    if not _is_number(cell):
        raise InputError(
            f"{path}, line {line}", f"{cell!r} is not a number", "export again, with decimal points"
        )
    return float(cell)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
