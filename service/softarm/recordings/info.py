"""``recording.toml``: what is known of a run."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from softarm.estimator.errors import InputError


def parse_info(source: str, data: bytes) -> dict[str, Any]:
    """Parse the text of ``recording.toml``.

    Raises:
        InputError: It is not TOML.
    """
    try:
        return tomllib.loads(data.decode("utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(source, f"is not TOML ({error})", "correct that line") from None


def read_info(path: Path) -> dict[str, Any]:
    """Read ``recording.toml``; empty where the file is absent."""
    return parse_info(str(path), path.read_bytes()) if path.is_file() else {}


def format_info(info: Mapping[str, Any]) -> bytes:
    """Write what is known of a run as TOML."""
    return tomli_w.dumps(info).encode()


def sidecar(path: Path) -> Path:
    """Return the place of the TOML beside a data file: ``recording.csv`` and ``recording.toml``."""
    return path.with_suffix(".toml")
