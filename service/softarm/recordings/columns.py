"""The canonical columns of a recording: their names, the stream each belongs to, and likely slips in naming.

| column | stream | field |
|---|---|---|
| ``pressure_<k>_pa`` | ``pressures`` | ``chamber_<k>_pa`` |
| ``pressure_cmd_<k>_pa`` | ``pressures_cmd`` | ``chamber_<k>_pa`` |
| ``frame_<section>_<x_m ... qz>`` | ``frame/<section>`` | ``x_m`` ... ``qz`` |
| ``bend_<section>_<x_rad, y_rad>`` | ``bend/<section>`` | ``x_rad``, ``y_rad`` |
| ``marker_<name>_<x_m, y_m, z_m>`` | ``marker/<name>`` | ``x_m``, ``y_m``, ``z_m`` |
| ``gauge_<name>_n`` | ``gauge/<name>`` | ``force_n`` |
| ``estimate_<what>`` | ``estimate`` | ``<what>`` |
"""

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass

from softarm.estimator.errors import InputError
from softarm.estimator.recording import BEND_SUFFIXES, MARKER_SUFFIXES, POSE_SUFFIXES

TIME = "t_s"
GROUPS = {"frame": POSE_SUFFIXES, "bend": BEND_SUFFIXES, "marker": MARKER_SUFFIXES}

NAME = r"[A-Za-z0-9](?:[A-Za-z0-9_-]*[A-Za-z0-9])?"
PRESSURE = re.compile(r"pressure_(cmd_)?(0|[1-9]\d*)_pa")
GROUPED = re.compile(
    "|".join(
        rf"(?P<{kind}>{kind})_(?P<{kind}_name>{NAME})_(?P<{kind}_field>{'|'.join(fields)})"
        for kind, fields in GROUPS.items()
    )
)
GAUGE = re.compile(rf"gauge_({NAME})_n")
ESTIMATE = re.compile(rf"estimate_({NAME})")

# Unit in a column's name, the SI unit and suffix in its place, and the factor that converts.
FOREIGN_UNITS = {
    "mbar": ("Pa", "_pa", 100.0),
    "hpa": ("Pa", "_pa", 100.0),
    "kpa": ("Pa", "_pa", 1e3),
    "mpa": ("Pa", "_pa", 1e6),
    "bar": ("Pa", "_pa", 1e5),
    "psi": ("Pa", "_pa", 6894.757),
    "mm": ("m", "_m", 1e-3),
    "cm": ("m", "_m", 1e-2),
    "deg": ("rad", "_rad", 0.017453292519943295),
    "mn": ("N", "_n", 1e-3),
    "ms": ("s", "_s", 1e-3),
    "us": ("s", "_s", 1e-6),
    "ns": ("s", "_s", 1e-9),
}


@dataclass(frozen=True)
class ColumnPlace:
    """Where a column's values travel in a stream.

    Args:
        topic: Name of the stream, ``pressures`` or ``marker/tip1``.
        field: Name of the value in a message of the stream.
    """

    topic: str
    field: str


def place(column: str) -> ColumnPlace | None:
    """Find the stream and the field of a canonical column; ``None`` for any other name."""
    if match := PRESSURE.fullmatch(column):
        return ColumnPlace("pressures_cmd" if match[1] else "pressures", f"chamber_{match[2]}_pa")
    if match := GROUPED.fullmatch(column):
        kind = next(kind for kind in GROUPS if match[kind])
        return ColumnPlace(f"{kind}/{match[f'{kind}_name']}", match[f"{kind}_field"])
    if match := GAUGE.fullmatch(column):
        return ColumnPlace(f"gauge/{match[1]}", "force_n")
    if match := ESTIMATE.fullmatch(column):
        return ColumnPlace("estimate", match[1])
    return None


def column_name(topic: str, field: str) -> str | None:
    """Name the canonical column of a field of a stream; ``None`` where there is none."""
    if topic in ("pressures", "pressures_cmd"):
        column = field.replace("chamber_", "pressure_cmd_" if topic == "pressures_cmd" else "pressure_", 1)
    elif topic.startswith("gauge/"):
        column = f"gauge_{topic.removeprefix('gauge/')}_n"
    else:
        column = f"{topic.replace('/', '_', 1)}_{field}"
    return column if place(column) == ColumnPlace(topic, field) else None


def check_names(source: str, columns: Sequence[str]) -> None:
    """Refuse duplicate, misnamed and missing columns.

    Raises:
        InputError: Names the file, the column and the cure.
    """
    _refuse_duplicates(source, columns)
    for column in columns:
        if column != TIME and place(column) is None:
            raise _misnamed(source, column)
    if TIME not in columns:
        raise InputError(source, f"column {TIME} is missing", "add the time in seconds as column t_s")
    _refuse_incomplete(source, columns)
    if not any(place(column) for column in columns if not column.startswith("estimate_")):
        raise InputError(
            source,
            "no usable channel: it holds neither a pressure nor a motion nor a force",
            "name the columns as docs/recordings.md lists them, such as pressure_0_pa or marker_tip1_x_m",
        )


def nearest(column: str) -> str:
    """Return the canonical name that a misnamed column most likely means."""
    if re.fullmatch(r"(host_)?(time|t|seconds)(_?stamp|_s|_sec)?", column.lower()):
        return TIME
    # A plain x is a length: only a column with a q can have meant a part of a quaternion.
    names = [name for name in _examples(column) if "q" in column.lower() or not re.search("_q[wxyz]$", name)]
    return difflib.get_close_matches(column.lower(), names, n=1, cutoff=0.0)[0]


def _refuse_duplicates(source: str, columns: Sequence[str]) -> None:
    places: dict[str, int] = {}
    for number, column in enumerate(columns, start=1):
        if column in places:
            raise InputError(
                f"{source}, column {column}",
                f"occurs twice, at positions {places[column]} and {number}",
                "rename or remove one of them",
            )
        places[column] = number


def _misnamed(source: str, column: str) -> InputError:
    where = f"{source}, column {column!r}"
    stem, _, unit = column.rpartition("_")
    if unit.lower() in FOREIGN_UNITS:
        si, suffix, factor = FOREIGN_UNITS[unit.lower()]
        canonical = stem.lower() + suffix
        if canonical == TIME or place(canonical):
            return InputError(
                where,
                f"is in {unit}, recordings are in {si}",
                f"multiply it by {factor:.7g} and name it {canonical}",
            )
    return InputError(
        where,
        "is not a column of a recording",
        f"the nearest is {nearest(column)} (docs/recordings.md lists all); rename or remove it",
    )


def _examples(column: str) -> list[str]:
    """List canonical names with the numbers and the words of a misnamed column."""
    numbers = re.findall(r"\d+", column) or ["0"]
    words = [word for word in re.split(r"[^A-Za-z0-9]+", column) if word] or ["tip"]
    examples = [f"pressure_{cmd}{int(k)}_pa" for k in numbers for cmd in ("", "cmd_")]
    for word in dict.fromkeys([*words, "base", "intermediate", "tip"]):
        examples += [f"{kind}_{word}_{field}" for kind, fields in GROUPS.items() for field in fields]
        examples.append(f"gauge_{word}_n")
    return examples


def _refuse_incomplete(source: str, columns: Sequence[str]) -> None:
    present = set(columns)
    for column in columns:
        spot = place(column)
        if spot is None or "/" not in spot.topic:
            continue
        kind, name = spot.topic.split("/", 1)
        for field in GROUPS.get(kind, ()):
            wanted = f"{kind}_{name}_{field}"
            if wanted not in present:
                raise InputError(
                    f"{source}, column {wanted}",
                    f"is missing, but {column} is there",
                    f"a {kind} needs {', '.join(GROUPS[kind])}; add it or remove the others",
                )
