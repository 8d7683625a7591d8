"""The canonical table as CSV or Parquet."""

import csv
from collections.abc import Mapping
from io import StringIO
from pathlib import Path

import numpy as np
import polars as pl

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.recording import Recording
from softarm.recordings.columns import TIME, check_names
from softarm.recordings.validate import row

LONGEST_SHOWN = 30
"""Characters of a bad cell that a message shows."""


def read_csv(path: Path) -> dict[str, Floats]:
    """Read a CSV file's columns; an empty cell becomes NaN, and blank lines at the end are passed over.

    Raises:
        InputError: The file is empty, a column is misnamed, a cell is not a number, or a row has not as many
            cells as the header, such as the last one of a file that was cut off.
    """
    source = str(path)
    header = _header(path)
    check_names(source, header)
    data = path.read_bytes().rstrip()
    try:
        table = pl.read_csv(data, schema=dict.fromkeys(header, pl.Float64), encoding="utf8")
    except pl.exceptions.NoDataError:
        return {name: np.empty(0) for name in header}
    except pl.exceptions.PolarsError:
        return _read_cell_by_cell(path, data, header)
    # the fast reader fills short rows with nulls
    if data.count(b",") != (table.height + 1) * (len(header) - 1):
        return _read_cell_by_cell(path, data, header)
    return _arrays(table)


def read_parquet(path: Path) -> dict[str, Floats]:
    """Read a Parquet file's columns; null becomes NaN.

    Raises:
        InputError: The file is not Parquet, a column is misnamed or not numeric.
    """
    source = str(path)
    try:
        table = pl.read_parquet(path)
    except (pl.exceptions.PolarsError, OSError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(source, f"cannot be read as Parquet ({reason})", "write it again") from None
    check_names(source, table.columns)
    for name, kind in table.schema.items():
        if not (kind.is_numeric() or kind == pl.Null):
            raise InputError(
                f"{source}, column {name}", f"holds {kind}, not numbers", "store it as 64-bit floating point"
            )
    return _arrays(table.cast(pl.Float64))


def write_csv(recording: Recording, path: Path) -> None:
    """Write the canonical table; NaN becomes an empty cell and numbers keep every digit."""
    _frame(recording).fill_nan(None).write_csv(path)


def write_parquet(recording: Recording, path: Path) -> None:
    """Write the canonical table as Parquet; NaN becomes null."""
    _frame(recording).fill_nan(None).write_parquet(path, compression="zstd")


def _header(path: Path) -> list[str]:
    source = str(path)
    with path.open(encoding="utf-8-sig", newline="") as file:
        try:
            header = next(csv.reader(file), [])
        except (UnicodeDecodeError, csv.Error):
            raise InputError(source, "is not a text file", "give a CSV file in UTF-8") from None
    if not any(header):
        raise InputError(source, "is empty", "give a file with a header line and samples")
    if len(header) == 1 and (";" in header[0] or "\t" in header[0]):
        raise InputError(
            f"{source}, line 1", "the cells are not separated by commas", "use commas, and points in numbers"
        )
    return [name.strip() for name in header]


def _arrays(table: pl.DataFrame) -> dict[str, Floats]:
    return {
        name: np.ascontiguousarray(table[name].fill_null(np.nan).to_numpy(), dtype=np.float64)
        for name in table.columns
    }


def _frame(recording: Recording) -> pl.DataFrame:
    columns: Mapping[str, Floats] = {TIME: recording.time, **recording.columns}
    return pl.DataFrame({name: pl.Series(name, values, dtype=pl.Float64) for name, values in columns.items()})


def _read_cell_by_cell(path: Path, data: bytes, header: list[str]) -> dict[str, Floats]:
    """Read a table that the fast reader refuses, to name the cell or row at fault."""
    columns: list[list[float]] = [[] for _ in header]
    # what is no text becomes a cell that is no number, whose row is then named
    reader = csv.reader(StringIO(data.decode("utf-8-sig", errors="replace"), newline=""))
    next(reader)
    for index, cells in enumerate(reader):
        if len(cells) != len(header):
            raise InputError(
                f"{path}, {row(str(path), index)}",
                f"has {len(cells)} cells, the header {len(header)}",
                "write one cell per column; remove the row if the file was cut off there",
            )
        for values, name, cell in zip(columns, header, cells, strict=True):
            values.append(_number(path, index, name, cell.strip()))
    return {name: np.array(values) for name, values in zip(header, columns, strict=True)}


def _number(path: Path, index: int, name: str, cell: str) -> float:
    if not cell:
        return np.nan
    try:
        if "_" not in cell:
            return float(cell)
    except ValueError:
        pass
    raise InputError(
        f"{path}, column {name}, {row(str(path), index)}",
        f"{cell[:LONGEST_SHOWN] + '...' * (len(cell) > LONGEST_SHOWN)!r} is not a number",
        "write numbers with a decimal point; leave the cell empty where a reading was lost",
    )
