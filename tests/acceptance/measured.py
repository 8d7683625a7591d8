"""``softarm bench measured``: run benchmarks, keep what they print, and write the figures into the documents.

Every figure in README and in ``docs/measured.md`` comes from the stored output of a command, so that pages
agree with each other and with what was run.
"""

import json
import os
import platform
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import click

from softarm.cli.output import notify
from softarm.common.errors import WorkFailedError
from softarm.common.tables import Cell, Table, as_markdown

CHECKOUT = Path(__file__).parents[2]
STORE = CHECKOUT / "docs" / "measured"
PAGE = CHECKOUT / "docs" / "measured.md"
README = CHECKOUT / "README.md"
BEGIN, END = "<!-- figures: begin -->", "<!-- figures: end -->"

COMMANDS: Mapping[str, tuple[str, ...]] = {
    "mesh": ("bench", "mesh", "--quick"),
    "sofa": ("bench", "sofa"),
    "verify": ("bench", "verify"),
    "step": ("bench", "step"),
    "latency": ("bench", "latency"),
    "arms": ("bench", "arms"),
    "safety": ("bench", "safety"),
    "soak": ("bench", "soak"),
    "faults": ("bench", "faults"),
    "drivers": ("bench", "drivers", "--quick"),
    "experiments": ("experiment", "all", "--fake", "--seeds", "3"),
    "demo": ("demo", "--once"),
}
"""The commands whose output is kept, in the order of the page."""


@dataclass(frozen=True)
class Figure:
    """One sentence of README with numbers out of stored tables.

    Args:
        sentence: Its text; ``{name}`` stands for a value.
        source: Name of the stored output.
        values: For each name: words that begin the table's title, what a row must hold, its column.
    """

    sentence: str
    source: str
    values: Mapping[str, tuple[str, Mapping[str, Cell], str]]


def find_value(tables: Sequence[Table], title: str, row: Mapping[str, Cell], column: str) -> Cell:
    """Look up one cell.

    Args:
        tables: Where to look.
        title: Words that the table's title contains.
        row: Cells that the row must hold; the first such row counts.
        column: Heading.

    Raises:
        WorkFailedError: There is no such cell.
    """
    for table in tables:
        if title in table.title:
            for candidate in table.rows:
                if all(candidate.get(key) == value for key, value in row.items()) and column in candidate:
                    return candidate[column]
    raise WorkFailedError(f"no cell {column} in a row with {dict(row)} of a table about {title!r}")


def sentence_of(figure: Figure, tables: Sequence[Table]) -> str:
    """Fill the numbers into a sentence, three significant digits each."""
    values = {name: find_value(tables, *where) for name, where in figure.values.items()}
    shown = {name: f"{float(f'{v:.3g}'):g}" if isinstance(v, float) else str(v) for name, v in values.items()}
    return figure.sentence.format(**shown)


def stored_tables(name: str, store: Path = STORE) -> tuple[dict[str, Any], tuple[Table, ...]]:
    """Read the stored output of a command: what was run, where and when, and its tables."""
    record = json.loads((store / f"{name}.json").read_text("utf-8"))
    documents = record["output"].get("tables", [record["output"]])
    tables = tuple(Table(d["title"], d["rows"], tuple(d["notes"])) for d in documents)
    return record, tables


def run_command(name: str, store: Path = STORE) -> None:
    """Run a command and keep what it prints.

    Raises:
        WorkFailedError: It printed no JSON.
    """
    words = COMMANDS[name]
    done = subprocess.run(
        [sys.executable, "-m", "softarm", *words, "--json"], check=False, stdout=subprocess.PIPE, text=True
    )
    try:
        output = json.loads(done.stdout.replace(f"{CHECKOUT}/", ""))
    except json.JSONDecodeError:
        raise WorkFailedError(
            f"softarm {' '.join(words)} ended with {done.returncode} and no table"
        ) from None
    record = {
        "command": f"softarm {' '.join(words)}",
        "status": done.returncode,
        "version": version("softarm"),
        "when": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        "machine": f"{os.cpu_count()} cores, {processor()}, Python {platform.python_version()}",
        "output": output,
    }
    store.mkdir(parents=True, exist_ok=True)
    (store / f"{name}.json").write_text(json.dumps(record, indent=1) + "\n", "utf-8")


def processor(information: Path = Path("/proc/cpuinfo")) -> str:
    """Return the name of the processor, as Linux knows it."""
    found = re.search(r"model name\s*:\s*(.+)", information.read_text()) if information.exists() else None
    return found[1] if found else platform.machine()


def measured_page(store: Path = STORE) -> str:
    """Write the page of all stored output."""
    parts = [
        "# Measured",
        "Every table is the output of the command above it, kept by `softarm bench measured --run NAME` "
        "in `docs/measured/`. Run the commands on your own machine: speeds depend on it.",
    ]
    for name in COMMANDS:
        if (store / f"{name}.json").exists():
            record, tables = stored_tables(name, store)
            status = "" if record["status"] == 0 else f" It ended with status {record['status']}."
            parts.append(f"## `{record['command']}`")
            parts.append(f"{record['when']}, version {record['version']}, {record['machine']}.{status}")
            parts.append(as_markdown(*tables).strip())
    return "\n\n".join(parts) + "\n"


def with_figures(readme: str, figures: Sequence[Figure], store: Path = STORE) -> str:
    """Replace the figures of README between their two marks; those without stored output are left out."""
    lines = [
        f"- {sentence_of(figure, stored_tables(figure.source, store)[1])}"
        for figure in figures
        if (store / f"{figure.source}.json").exists()
    ]
    before, _, rest = readme.partition(BEGIN)
    return f"{before}{BEGIN}\n" + "\n".join(lines) + f"\n{END}{rest.partition(END)[2]}"


@click.command()
@click.option("--run", "names", multiple=True, type=click.Choice(list(COMMANDS)), help="Run this one anew.")
def command(names: tuple[str, ...]) -> int:
    """Run benchmarks, keep their output, and renew README and docs/measured.md from all that is kept.

    Example: softarm bench measured --run step --run mesh
    """
    from acceptance.figures import FIGURES

    for name in names:
        notify(f"running softarm {' '.join(COMMANDS[name])}")
        run_command(name)
    PAGE.write_text(measured_page(), "utf-8")
    README.write_text(with_figures(README.read_text("utf-8"), FIGURES), "utf-8")
    notify(f"wrote {PAGE.relative_to(CHECKOUT)} and the figures of README.md")
    return 0
