"""The page of the proof: tables that were made anew take the place of those of the same title."""

import re
from collections.abc import Sequence

from softarm.common.tables import Table, as_markdown

TITLE = re.compile(r"^\*\*(.+)\*\*$", re.MULTILINE)


def renewed(page: str, tables: Sequence[Table]) -> str:
    """Put tables into a page; what it says before its first table, and its other tables, stay.

    Args:
        page: What there is, in Markdown.
        tables: Tables that were made; new titles come last.
    """
    heads = list(TITLE.finditer(page))
    starts = [*(head.start() for head in heads), len(page)]
    sections = {head[1]: page[head.start() : starts[k + 1]].strip() for k, head in enumerate(heads)}
    sections |= {table.title: as_markdown(table).strip() for table in tables}
    return "\n\n".join([page[: starts[0]].strip(), *sections.values()]) + "\n"
