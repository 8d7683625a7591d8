"""``recording.toml``: the facts of a run."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import tomli_w

from softarm.estimator.errors import InputError
from softarm.estimator.files import parse_toml

GRAVITY_RANGE = (9.0, 11.0)  # m/s2; on Earth 9.76 to 9.84, so anything else is another unit or incomplete


def parse_info(source: str, data: bytes) -> dict[str, Any]:
    """Parse the text of ``recording.toml``, and check the keys that have a meaning for softarm.

    Raises:
        InputError: It is not TOML, or a key has a value that cannot be used.
    """
    info = parse_toml(source, data)
    for key, (usable, cure) in CHECKS.items():
        if key in info and not usable(info[key]):
            raise InputError(f"{source}, {key}", f"is {info[key]!r}", cure)
    return info


def read_info(path: Path) -> dict[str, Any]:
    """Read ``recording.toml``; empty where the file is absent."""
    return parse_info(str(path), path.read_bytes()) if path.is_file() else {}


def format_info(info: Mapping[str, Any]) -> bytes:
    """Write the facts of a run as TOML."""
    return tomli_w.dumps(info).encode()


def sidecar(path: Path) -> Path:
    """Return the place of the TOML beside a data file: ``recording.csv`` and ``recording.toml``."""
    return path.with_suffix(".toml")


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and bool(value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_rate(value: Any) -> bool:
    return _is_number(value) and value > 0


def _length(value: Any) -> float:
    """Return the length of a vector; NaN for what is none."""
    is_vector = isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))
    return math.hypot(*value) if is_vector else math.nan


def _is_direction(value: Any) -> bool:
    return _length(value) > 0.0


def _is_gravity(value: Any) -> bool:
    """Zero is the gravity of a simulation without weight."""
    length = _length(value)
    return length == 0.0 or GRAVITY_RANGE[0] <= length <= GRAVITY_RANGE[1]


CHECKS: Mapping[str, tuple[Callable[[Any], bool], str]] = {
    "specimen": (_is_name, "give the path or name of a specimen"),
    "rate_hz": (_is_rate, "give samples per second"),
    "session_start_s": (_is_number, "give seconds"),
    "gravity_m_s2": (_is_gravity, "give x, y and z in the base frame, in m/s2, of length 9.81"),
    "gauge_section": (_is_name, "give the name of a section"),
    "gauge_direction": (_is_direction, "give x, y and z of the pull in the base frame"),
}
"""Keys with a meaning: whether a value can be used, and what to write instead."""
