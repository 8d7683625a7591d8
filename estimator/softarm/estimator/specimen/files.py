"""Specimens in TOML files: reading, writing, and the ones that come with the package."""

import os
from importlib import resources
from pathlib import Path

import tomli_w
from pydantic import ValidationError

from softarm.estimator.errors import InputError, suggest
from softarm.estimator.files import parse_toml, require_free, write_whole
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
        shipped = resources.files("softarm.estimator.specimen") / "shipped" / f"{source}.toml"
        return parse_specimen(shipped.read_bytes(), str(source))
    path = Path(source)
    return parse_specimen(_read(path), str(source)).placed_in(path.resolve().parent)


def parse_specimen(data: bytes, file: str) -> Specimen:
    """Validate the bytes of a specimen file, which errors call ``file``.

    Raises:
        InputError: As in ``load_specimen``.
    """
    table = parse_toml(file, data)
    try:
        return Specimen.model_validate(table)
    except ValidationError as error:
        raise describe_errors(file, error, Specimen) from None


def require_free_specimen(path: Path, *, force: bool) -> None:
    """Refuse a place for a specimen file, before the work for it begins.

    Raises:
        InputError: The path exists and ``force`` is off, its folder can neither be written nor made, or it is
            the name of a shipped specimen, which would be read in its place.
    """
    if str(path) in SHIPPED:
        raise InputError(str(path), "is the name of a shipped specimen", f"write to {path}.toml, for example")
    require_free(path, force=force)


def save_specimen(specimen: Specimen, path: str | Path) -> None:
    """Write a specimen as TOML, whole or not at all; missing folders are made.

    The path of a mesh file is rewritten so that it holds from the new place.

    Args:
        specimen: What to write; values left to their default are left out.
        path: The file; one that exists is replaced.

    Raises:
        InputError: The folder cannot be written to.
    """
    target = Path(path)
    write_whole({target: tomli_w.dumps(specimen_table(specimen, target.resolve().parent)).encode()})


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


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        cure = suggest(str(path), SHIPPED, f"give a TOML file or one of {', '.join(SHIPPED)}", cutoff=0.6)
        raise InputError(str(path), "no such specimen", cure) from None
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({error.strerror})", "give a TOML file") from None
