"""What every command shares: tables or JSON on stdout, progress on stderr, common options and arguments."""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table as RichTable

from softarm.common.tables import Cell, Table, text

Command = TypeVar("Command", bound=Callable[..., Any])


def show(*tables: Table, as_json: bool) -> None:
    """Print tables on stdout, for people or as one JSON document."""
    if as_json:
        documents = [{"title": t.title, "rows": list(map(_clean, t.rows)), "notes": t.notes} for t in tables]
        click.echo(json.dumps(documents[0] if len(documents) == 1 else {"tables": documents}, indent=1))
        return
    console = Console(width=None if Console().is_terminal else 160, highlight=False)
    for table in tables:
        console.print(_rich_table(table))
        for note in table.notes:
            console.print(note, markup=False)


def _clean(row: Mapping[str, Cell]) -> dict[str, Cell]:
    """Replace what JSON has no word for."""
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in row.items()}


def _rich_table(table: Table) -> RichTable:
    result = RichTable(title=table.title, title_justify="left", title_style="bold")
    headings = list(table.rows[0]) if table.rows else []
    for heading in headings:
        numeric = all(isinstance(row.get(heading), int | float | None) for row in table.rows)
        result.add_column(heading.replace("_", " "), justify="right" if numeric else "left", overflow="fold")
    for row in table.rows:
        result.add_row(*(text(row.get(heading)).replace("[", r"\[") for heading in headings))
    return result


@contextmanager
def progress(what: str, total: float | None = None) -> Iterator[Callable[[float], None]]:
    """Show a progress bar on stderr while a block of work runs; nothing where stderr is no terminal.

    Args:
        what: What is being done.
        total: Steps to do; ``None`` shows that work goes on without saying how far it is.

    Yields:
        A function that advances the bar by some steps.
    """
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=total)

        def advance(steps: float) -> None:
            bar.advance(task, steps)

        yield advance


def say(message: str) -> None:
    """Tell the user on stderr what happened, such as which file was written."""
    click.echo(message, err=True)


def json_option(command: Command) -> Command:
    """Add ``--json``, passed as ``as_json``."""
    return click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")(command)


def quick_option(command: Command) -> Command:
    """Add ``--quick``, passed as ``quick``: a smaller form of a benchmark."""
    return click.option("--quick", is_flag=True, help="Run a smaller form.")(command)


def force_option(command: Command) -> Command:
    """Add ``--force``, passed as ``force``: replace what an output path already holds."""
    return click.option("--force", is_flag=True, help="Replace an existing output.")(command)


def specimen_option(command: Command) -> Command:
    """Add ``--specimen``, passed as ``specimen``: a path or the name of a shipped specimen."""
    return click.option(
        "--specimen",
        "-s",
        metavar="S",
        help="A specimen file, or the name of a shipped one: sopra, single_segment, beam. "
        "By default the specimen that the recording names.",
    )(command)


def recording_argument(command: Command) -> Command:
    """Add the argument RECORDING, passed as ``recording``."""
    return click.argument("recording", type=click.Path(path_type=Path))(command)


def recordings_argument(command: Command) -> Command:
    """Add the argument RECORDING..., passed as the tuple ``recordings``."""
    return click.argument(
        "recordings", metavar="RECORDING...", nargs=-1, required=True, type=click.Path(path_type=Path)
    )(command)


def out_option(help_text: str) -> Callable[[Command], Command]:
    """Add ``--out``, passed as ``out``."""
    return click.option("--out", "-o", type=click.Path(path_type=Path), help=help_text)
