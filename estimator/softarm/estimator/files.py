"""Files: TOML that is read, outputs that appear whole or not at all."""

import os
import secrets
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from softarm.estimator.errors import InputError


def read_toml(path: Path, advice: str = "check the path") -> tuple[dict[str, Any], str]:
    """Read a TOML file; return its table and its text.

    Args:
        path: The file.
        advice: What to do where there is no file.

    Raises:
        InputError: It cannot be read or is not TOML.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({error.strerror})", advice) from None
    return parse_toml(str(path), data), data.decode("utf-8-sig")


def parse_toml(source: str, data: bytes) -> dict[str, Any]:
    """Parse TOML; a mark of the byte order, which some editors write, is no error.

    Raises:
        InputError: It is not TOML in UTF-8.
    """
    try:
        return tomllib.loads(data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise InputError(source, f"cannot be read ({error.reason})", "write it in UTF-8") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(source, f"is not TOML ({error})", "correct that line") from None


def require_free(path: Path, *, force: bool) -> None:
    """Refuse a place for an output, before the work for it begins.

    Raises:
        InputError: The path exists and ``force`` is off, or its folder can neither be written nor made.
    """
    if path.exists() and not force:
        raise InputError(str(path), "exists already", "give another path, or --force to replace it")
    there = next(parent for parent in path.absolute().parents if parent.exists())
    if not there.is_dir() or not os.access(there, os.W_OK):
        what = "cannot be written to" if there.is_dir() else "is not a folder"
        raise InputError(str(there), what, "give a folder that you may write to")


def require_writable(where: str, folder: Path) -> None:
    """Make a folder and check that files can be written there.

    Args:
        where: What names the folder, such as a field of a configuration.
        folder: The folder.

    Raises:
        InputError: It cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        what = f"{folder} cannot be written ({error.strerror})"
        raise InputError(
            where, what, "name a folder that the service may write, or change its rights"
        ) from None


@contextmanager
def whole_files(*paths: Path) -> Iterator[tuple[Path, ...]]:
    """Write files under other names beside their place and rename them once all are on the disk.

    Args:
        paths: The files' final places; missing folders are made.

    Yields:
        Where to write, one path per final place.

    Raises:
        InputError: A folder cannot be made or written to, or a path is no file, such as a device.
    """
    made = [folder for path in paths for folder in _missing_folders(path.parent)]
    drafts: list[Path] = []
    try:
        drafts.extend(map(_draft, paths))
        yield tuple(drafts)
        for draft in drafts:  # a power cut leaves the old file or the new one, whole
            with draft.open("rb") as file:
                os.fsync(file.fileno())
        for draft, path in zip(drafts, paths, strict=True):
            draft.replace(path)
    except BaseException:
        for draft in drafts:
            draft.unlink(missing_ok=True)
        for folder in reversed(made):
            _remove_if_empty(folder)
        raise


def write_whole(contents: Mapping[Path, bytes]) -> None:
    """Write some files whole."""
    with whole_files(*contents) as drafts:
        for draft, data in zip(drafts, contents.values(), strict=True):
            draft.write_bytes(data)


def _draft(path: Path) -> Path:
    draft = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        if path.exists() and not path.is_file():
            raise InputError(str(path), "is not a file", "give a path that can be replaced")
        path.parent.mkdir(parents=True, exist_ok=True)
        draft.touch(exist_ok=False)
    except OSError as error:
        what = f"cannot be written ({error.strerror})"
        raise InputError(str(path), what, "give a path in a folder that you may write to") from None
    return draft


def _missing_folders(folder: Path) -> list[Path]:
    return [parent for parent in reversed([folder, *folder.parents]) if not parent.exists()]


def _remove_if_empty(folder: Path) -> None:
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
