"""Specimens in TOML files: reading, writing, and the ones that come with the package."""

import os
import tempfile
import tomllib
from importlib import resources
from pathlib import Path

import tomli_w
from pydantic import ValidationError

from softarm.estimator.errors import InputError, suggest
from softarm.estimator.specimen.problems import describe_errors
from softarm.estimator.specimen.specimen import Specimen

SHIPPED = ("sopra", "single_segment", "beam")


def load_specimen(source: str | Path) -> Specimen:
    """Read a specimen.

    Args:
        source: Path of a TOML file, or the name of a shipped specimen.

    Raises:
        InputError: The file is absent or unreadable, its TOML is malformed, or values are wrong; in one
            line with every error, each with its field, its value, the limit and the cure.
    """
    if str(source) in SHIPPED:
        text = (resources.files("softarm.estimator.specimen") / "shipped" / f"{source}.toml").read_text(
            "utf-8"
        )
        return parse_specimen(text, str(source))
    path = Path(source)
    return parse_specimen(_read(path), str(source)).placed_in(path.resolve().parent)


def parse_specimen(text: str, file: str) -> Specimen:
    """Validate the TOML text of a specimen file, which errors call ``file``.

    Raises:
        InputError: As in ``load_specimen``.
    """
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(file, f"not TOML: {error}", "correct the syntax on that line") from None
    try:
        return Specimen.model_validate(table)
    except ValidationError as error:
        raise describe_errors(file, error, Specimen) from None


def save_specimen(specimen: Specimen, path: str | Path) -> None:
    """Write a specimen as TOML, whole or not at all; missing folders are made.

    The path of a mesh file is rewritten so that it holds from the new place.

    Raises:
        InputError: The folder cannot be written to.
    """
    target = Path(path)
    text = tomli_w.dumps(specimen_table(specimen, target.resolve().parent))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        descriptor, partial = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=".part")
    except OSError as error:
        raise InputError(str(target), f"cannot write: {error.strerror}", "choose a writable folder") from None
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            # On the disk before it replaces the old file, so that a power cut leaves one of the two whole.
            os.fsync(file.fileno())
        # mkstemp lets only the owner read.
        Path(partial).chmod(0o644)
        Path(partial).replace(target)
    except OSError as error:
        raise InputError(str(target), f"cannot write: {error.strerror}", "choose a writable file") from None
    finally:
        Path(partial).unlink(missing_ok=True)


def specimen_table(specimen: Specimen, folder: Path) -> dict[str, object]:
    """Return the table that a specimen's file in some folder holds, without values left to their default."""
    table: dict[str, object] = specimen.model_dump(
        mode="json", by_alias=True, exclude_none=True, exclude_defaults=True
    )
    geometry = specimen.geometry
    if geometry.kind == "mesh_file":
        moved = os.path.relpath(specimen.folder / geometry.path, folder)
        table["geometry"] = {**geometry.model_dump(mode="json", exclude_none=True), "path": moved}
    return {"schema": specimen.schema_, **table}


def _read(path: Path) -> str:
    try:
        return path.read_text("utf-8")
    except FileNotFoundError:
        cure = suggest(str(path), SHIPPED, f"give a TOML file or one of {', '.join(SHIPPED)}", cutoff=0.6)
        raise InputError(str(path), "no such specimen", cure) from None
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error.reason
        raise InputError(str(path), f"cannot be read ({reason})", "give a TOML file in UTF-8") from None
