"""The page of a proof: tables that were made anew replace those of the same title."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from softarm.common.tables import Table, as_markdown
from softarm.estimator.files import write_whole

TITLE = re.compile(r"^\*\*(.+)\*\*$", re.MULTILINE)


def from_source(tables: Sequence[Table], source: str) -> list[Table]:
    """Add to each title where the trials come from, so that a page can hold the tables of several sources."""
    return [replace(table, title=f"{table.title}: {source}") for table in tables]


def write_page(path: Path, tables: Sequence[Table], head: str) -> None:
    """Put tables into a page.

    Args:
        path: The page, in Markdown.
        tables: Tables that were made; see ``renewed``.
        head: Beginning of a page that does not exist yet.
    """
    page = renewed(path.read_text("utf-8") if path.exists() else head, tables)
    write_whole({path: page.encode()})


def renewed(page: str, tables: Sequence[Table]) -> str:
    """Put tables into a page; its text before the first table, and its other tables, stay.

    Args:
        page: What there is, in Markdown.
        tables: Tables that were made; new titles come last.
    """
    heads = list(TITLE.finditer(page))
    starts = [*(head.start() for head in heads), len(page)]
    sections = {head[1]: page[head.start() : starts[k + 1]].strip() for k, head in enumerate(heads)}
    sections |= {table.title: as_markdown(table).strip() for table in tables}
    return "\n\n".join([page[: starts[0]].strip(), *sections.values()]) + "\n"
