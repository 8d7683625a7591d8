"""The names that Qualisys labels and rigid bodies get in a recording."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from softarm.estimator.errors import InputError

MILLIMETRE = 1e-3


def mapped_names(source: str, labels: Sequence[str], info: Mapping[str, Any], table: str) -> list[str | None]:
    """Translate labels through the table of a column map.

    Args:
        source: The export, for messages.
        labels: Labels of markers or names of rigid bodies, as exported.
        info: The column map; without the table every label keeps its name, with it the labels that it
            leaves out are dropped.
        table: ``markers`` or ``bodies``.

    Returns:
        The name of each label, ``None`` for one to be dropped.

    Raises:
        InputError: The map is no table of names, names a label that is not there, gives a name twice, or a
            name is unusable.
    """
    mapping = info.get(table)
    if mapping is not None:
        _check_names(f"{source}, {table}", mapping)
    if mapping is None:
        names: list[str | None] = [_plain(label) for label in labels]
    else:
        absent = [label for label in mapping if label not in labels]
        if absent:
            raise InputError(
                f"{source}, {table}", f"there is no {absent[0]!r}", f"the export has: {', '.join(labels)}"
            )
        names = [mapping.get(label) for label in labels]
    kept = [name for name in names if name is not None]
    for name in kept:
        if kept.count(name) > 1:
            raise InputError(
                f"{source}, {table}", f"two of them are called {name!r}", "give each its own name"
            )
        if not re.fullmatch(r"[A-Za-z0-9](?:[A-Za-z0-9_-]*[A-Za-z0-9])?", name):
            raise InputError(
                f"{source}, {table}",
                f"{name!r} cannot be part of a column's name",
                "use letters, digits, _ and -",
            )
    return names


def _check_names(where: str, mapping: object) -> None:
    if not isinstance(mapping, Mapping):
        raise InputError(where, f"is {mapping!r}, not a table", 'write a line "label" = "name" for each')
    for label, name in mapping.items():
        if not isinstance(name, str):
            raise InputError(where, f"{label!r} is {name!r}, not a name", "give a text in quotes")


def _plain(label: str) -> str:
    """Convert a label to a part of a column's name: ``Tip - 1`` becomes ``Tip_1``."""
    return re.sub(r"[^A-Za-z0-9]+", "_", label).strip("_")
