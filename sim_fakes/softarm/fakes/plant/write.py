"""Writing a generated recording: the canonical table, its facts, and the truth apart."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import tomli_w

from softarm.estimator.errors import InputError
from softarm.estimator.files import write_whole
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
        InputError: The folder already holds a recording, or cannot be written.
    """
    table = folder / "recording.csv"
    if table.exists():
        raise InputError(str(table), "exists", "give another folder or remove it")
    files = {
        table: _as_csv(generated, generated.columns),
        folder / "recording.toml": _as_toml(generated.info),
    }
    if truth is not None:
        files |= {
            truth / "truth.csv": _as_csv(generated, _true_columns(generated)),
            truth / "truth.toml": _as_toml(generated.truth),
        }
    write_whole(files)


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


def _as_csv(generated: Generated, columns: Mapping[str, Any]) -> bytes:
    """Write times and columns as CSV; NaN becomes an empty cell."""
    named = {"t_s": generated.time, **columns}
    rounded = {name: np.round(values, 2 if name.endswith("_pa") else 9) for name, values in named.items()}
    return pl.DataFrame(rounded).fill_nan(None).write_csv().encode()


def _as_toml(table: Mapping[str, Any]) -> bytes:
    return tomli_w.dumps(table).encode()
