"""What every command shares: tables or JSON on stdout, progress on stderr, common options and arguments."""

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table as RichTable

from softarm.common.tables import Cell, Table, heading, text
from softarm.estimator.files import require_free

Command = TypeVar("Command", bound=Callable[..., Any])


class Folder(click.Path):
    """A folder to write into; one that cannot be written is refused before the work for it begins."""

    def __init__(self) -> None:
        super().__init__(path_type=Path, file_okay=False)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the folder.

        Raises:
            InputError: It cannot be written; the default is not checked, since not every use needs it.
        """
        folder: Any = super().convert(value, param, ctx)
        if param is None or value != param.default:
            require_free(folder / "file", force=True)
        return folder


class NumberRange(click.FloatRange):
    """A range of numbers that holds no ``nan``, of which every comparison is false."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number, and refuse what is none."""
        number = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"{value!r} is not a number.", param, ctx)
        return number


PATH = click.Path(path_type=Path)
"""Type of an option that is a path."""
FOLDER = Folder()
"""Type of an option that is a folder to write into."""
PICTURE = click.Path(path_type=Path, dir_okay=False)
"""Type of an option that is a picture to write."""
PORT = click.IntRange(1, 65535)
"""Type of an option that is a TCP port."""
LINE_EVERY_S = 10.0
"""Time between two lines of progress where stderr is no terminal."""
LEAST_SHARE = 0.02
"""Share of the work, after its first step, from which the time left is shown."""


def show(*tables: Table, as_json: bool) -> None:
    """Print tables on stdout, for people or as one JSON document."""
    if as_json:
        documents = [{"title": t.title, "rows": list(map(_clean, t.rows)), "notes": t.notes} for t in tables]
        click.echo(json.dumps(documents[0] if len(documents) == 1 else {"tables": documents}, indent=1))
        return
    # A pipe has no width of its own, and the usual 80 columns would fold most tables.
    console = Console(width=None if Console().is_terminal else 160, highlight=False)
    for table in tables:
        console.print(_rich_table(table))
        for note in table.notes:
            console.print(note, markup=False)


def _clean(row: Mapping[str, Cell]) -> dict[str, Cell]:
    """Replace what JSON cannot represent."""
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in row.items()}


def _rich_table(table: Table) -> RichTable:
    result = RichTable(title=table.title, title_justify="left", title_style="bold")
    keys = list(table.rows[0]) if table.rows else []
    for key in keys:
        numeric = all(isinstance(row.get(key), int | float | None) for row in table.rows)
        result.add_column(heading(key), justify="right" if numeric else "left", overflow="fold")
    for row in table.rows:
        result.add_row(*(text(row.get(key)).replace("[", r"\[") for key in keys))
    return result


@contextmanager
def progress(what: str, total: float | None = None) -> Iterator[Callable[[float], None]]:
    """Show on stderr how far a block of work is: a bar on a terminal, else a line every ten seconds.

    Args:
        what: What is being done.
        total: Steps to do, at most; ``None`` shows that work goes on, but not how far it is.

    Yields:
        A function that advances the bar by some steps.
    """
    console = Console(stderr=True)
    if not console.is_terminal:
        yield ProgressLines(what, total).advance
        return
    pace = Pace(total)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(what, total=total, left="")

        def advance(steps: float) -> None:
            pace.advance(steps)
            bar.update(task, advance=steps, left=pace.left)

        yield advance


class Pace:
    """Counts steps, and estimates the time left from those after the first, which often compiles and loads.

    Args:
        total: Steps to do, at most; ``None`` where that is not known.
        clock: Monotonic time [s].
    """

    def __init__(self, total: float | None, clock: Callable[[], float] = time.monotonic) -> None:
        self._total = total
        self._clock = clock
        self._began_s = self._now_s = clock()
        self._done = 0.0
        self._first: tuple[float, float] | None = None

    def advance(self, steps: float) -> None:
        """Count steps that are done."""
        self._done += steps
        self._now_s = self._clock()
        self._first = self._first or (self._done, self._now_s)

    @property
    def so_far(self) -> str:
        """What is done, in how much time."""
        spent_s = self._now_s - self._began_s
        if not self._total:
            return f"{self._done:.0f} steps in {spent_s:.0f} s"
        return f"{100.0 * min(self._done / self._total, 1.0):.0f} % after {spent_s:.0f} s"

    @property
    def left(self) -> str:
        """How much time is left if all steps are needed and take as long as so far; empty while unknown."""
        if not self._total or self._first is None:
            return ""
        done, since_s = self._done - self._first[0], self._now_s - self._first[1]
        if done < LEAST_SHARE * self._total:
            return ""
        return f"about {since_s * max(self._total - self._done, 0.0) / done:.0f} s left at this pace"


class ProgressLines:
    """Reports how far work has come, for logs and pipes: at most a line every ten seconds.

    Args:
        what: What is being done.
        total: Steps to do, at most; ``None`` where that is not known.
        clock: Monotonic time [s].
    """

    def __init__(self, what: str, total: float | None, clock: Callable[[], float] = time.monotonic) -> None:
        self._what = what
        self._pace = Pace(total, clock)
        self._clock = clock
        self._reported_s = clock()

    def advance(self, steps: float) -> None:
        """Count steps that are done."""
        self._pace.advance(steps)
        now_s = self._clock()
        if now_s - self._reported_s >= LINE_EVERY_S:
            self._reported_s = now_s
            left = self._pace.left
            notify(f"{self._what}: {self._pace.so_far}{left and f', {left}'}")


def notify(message: str) -> None:
    """Print what happened to stderr, such as which file was written."""
    click.echo(message, err=True)


def json_option(command: Command) -> Command:
    """Add ``--json``, passed as ``as_json``."""
    return click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")(command)


def quick_option(command: Command) -> Command:
    """Add ``--quick``, passed as ``quick``: a smaller form of a benchmark."""
    return click.option("--quick", is_flag=True, help="Run a shorter version.")(command)


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
    return click.argument("recording", type=PATH)(command)


def recordings_argument(command: Command) -> Command:
    """Add the argument RECORDING..., passed as the tuple ``recordings``."""
    return click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True, type=PATH)(command)


def out_option(help_text: str) -> Callable[[Command], Command]:
    """Add ``--out``, passed as ``out``."""
    return click.option("--out", "-o", type=PATH, help=help_text)


def folder_option(help_text: str, default: str | None = None) -> Callable[[Command], Command]:
    """Add ``--out`` that is a folder, passed as ``out``."""
    shown = default is not None
    return click.option("--out", "-o", type=FOLDER, default=default, show_default=shown, help=help_text)
