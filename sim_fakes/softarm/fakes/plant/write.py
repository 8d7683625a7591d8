"""Writing a generated recording: the canonical table, what is known of it, and the truth apart."""

from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import tomli_w

from softarm.estimator.errors import InputError
from softarm.fakes.plant.generate import Generated

SECTION_FORCE = "force_{}_{}_n"


def write(generated: Generated, folder: Path, truth: Path | None = None) -> None:
    """Write ``recording.csv`` and ``recording.toml`` to a folder, and the truth to another.

    Args:
        generated: What to write.
        folder: Made when absent; must not hold a recording.
        truth: Folder of ``truth.toml`` and ``truth.csv`` (true forces on the sections and chamber pressures);
            left out, the truth is not written.

    Raises:
        InputError: The folder already holds a recording.
    """
    table = folder / "recording.csv"
    if table.exists():
        raise InputError(str(table), "exists", "give another folder or remove it")
    folder.mkdir(parents=True, exist_ok=True)
    _write_table(table, {"t_s": generated.time, **generated.columns})
    _write_toml(folder / "recording.toml", generated.info)
    if truth is not None:
        truth.mkdir(parents=True, exist_ok=True)
        _write_toml(truth / "truth.toml", generated.truth)
        _write_table(truth / "truth.csv", {"t_s": generated.time, **_true_columns(generated)})


def _true_columns(generated: Generated) -> dict[str, Any]:
    """Name what really acted."""
    forces = generated.run.forces
    columns = {
        SECTION_FORCE.format(section, axis): forces[:, number, index]
        for number, section in enumerate(generated.run.sections)
        for index, axis in enumerate("xyz")
    }
    chambers = {f"pressure_{k}_pa": column for k, column in enumerate(generated.run.chambers.T)}
    return columns | chambers


def _write_table(path: Path, columns: dict[str, Any]) -> None:
    """Write columns as CSV; NaN becomes an empty cell."""
    rounded = {name: np.round(values, 2 if name.endswith("_pa") else 9) for name, values in columns.items()}
    pl.DataFrame(rounded).fill_nan(None).write_csv(path)


def _write_toml(path: Path, table: dict[str, Any]) -> None:
    """Write a table as TOML."""
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
