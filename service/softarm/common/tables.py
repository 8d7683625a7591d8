"""Tables as commands print them: on the screen, as JSON, as Markdown in a page."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

Cell = str | int | float | bool | None
TINY = 1e-15
UNITS = {"pa": "Pa", "kpa": "kPa", "n": "N", "hz": "Hz"}
"""Symbols of units that have capital letters, by how keys write them."""


@dataclass(frozen=True)
class Table:
    """A table that a command prints.

    Args:
        title: One line above the table.
        rows: One mapping per row; the keys of the first row are the headings and carry the unit
            (``force_rms_n``), in JSON as they are, on the screen as :func:`heading` writes them.
        notes: Sentences below the table: what was compared with what, and how.
    """

    title: str
    rows: Sequence[Mapping[str, Cell]]
    notes: tuple[str, ...] = ()


def as_markdown(*tables: Table) -> str:
    """Write tables as Markdown, for pages of the documentation that a command prints.

    A table without rows has no headings: its title and its notes are written alone.
    """
    parts = []
    for table in tables:
        lines = [f"**{table.title}**", ""]
        if table.rows:
            keys = list(table.rows[0])
            lines += [
                _markdown_row([heading(key) for key in keys]),
                "|" + "---|" * len(keys),
                *(_markdown_row([text(row.get(key)) for key in keys]) for row in table.rows),
                "",
            ]
        parts.append("\n".join([*lines, *table.notes]))
    return "\n\n".join(parts)


def _markdown_row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def heading(key: str) -> str:
    """Write the heading of a column: ``limit_kpa`` becomes ``limit kPa``."""
    *words, last = key.split("_")
    return " ".join([*words, UNITS.get(last, last) if words else last])


def text(value: Cell) -> str:
    """Write one cell: four significant digits, a dash where there is nothing, 0 for rounding."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) > TINY else "0"
    return str(value)
