"""The figures of the documents come from stored output, and from nowhere else."""

import json
import subprocess

import click
import pytest

from acceptance.figures import FIGURES
from acceptance.measured import (
    BEGIN,
    CHECKOUT,
    COMMANDS,
    END,
    PAGE,
    README,
    Figure,
    find_value,
    measured_page,
    run_command,
    stored_tables,
    with_figures,
)
from softarm.cli import softarm
from softarm.common.errors import WorkFailedError
from softarm.common.tables import Table

TABLES = (
    Table(
        "sopra: steps", ({"scheme": "reused", "median_ms": 9.3456}, {"scheme": "fresh", "median_ms": 20.0})
    ),
)
FIGURE = Figure("A step takes {ms} ms.", "step", {"ms": ("steps", {"scheme": "reused"}, "median_ms")})


@pytest.fixture
def store(tmp_path):
    output = {"title": "sopra: steps", "rows": list(TABLES[0].rows), "notes": ["One note."]}
    record = {
        "command": "softarm bench step",
        "status": 1,
        "version": "0.1.0",
        "when": "today",
        "machine": "2 cores",
        "output": output,
    }
    (tmp_path / "step.json").write_text(json.dumps(record))
    return tmp_path


def test_a_value_is_found_by_title_row_and_column():
    assert find_value(TABLES, "steps", {"scheme": "fresh"}, "median_ms") == 20.0


def test_a_value_that_is_not_there_is_refused():
    with pytest.raises(WorkFailedError, match="no cell median_ms"):
        find_value(TABLES, "steps", {"scheme": "other"}, "median_ms")


def test_the_page_has_every_table_and_says_when_a_command_failed(store):
    page = measured_page(store)
    assert "## `softarm bench step`" in page
    assert "It ended with status 1." in page
    assert "| reused | 9.346 |" in page
    assert "One note." in page


def test_figures_replace_those_between_the_marks(store):
    readme = f"before\n{BEGIN}\n- old\n{END}\nafter\n"
    wanted = f"before\n{BEGIN}\n- A step takes 9.35 ms.\n{END}\nafter\n"
    assert with_figures(readme, (FIGURE,), store) == wanted


def test_a_figure_without_stored_output_is_left_out(tmp_path):
    assert "A step" not in with_figures(f"{BEGIN}{END}", (FIGURE,), tmp_path)


def test_one_table_alone_is_read_too(store):
    _, tables = stored_tables("step", store)
    assert [table.title for table in tables] == ["sopra: steps"]


def test_files_in_the_checkout_are_kept_by_their_place_in_it(tmp_path, monkeypatch):
    printed = json.dumps({"title": "Forces", "rows": [], "notes": [f"Recording: {CHECKOUT}/out/force.mcap"]})
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: subprocess.CompletedProcess((), 0, printed))
    run_command("demo", tmp_path)
    assert "Recording: out/force.mcap" in measured_page(tmp_path)


def test_readme_and_page_are_what_the_stored_output_says():
    assert PAGE.read_text("utf-8") == measured_page()
    readme = README.read_text("utf-8")
    assert readme == with_figures(readme, FIGURES)


@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_every_command_whose_output_is_kept_is_understood(words):
    name, command, left = "softarm", softarm, [*words, "--json"]
    while isinstance(command, click.Group):
        name, command, left = command.resolve_command(click.Context(command), left)
    command.make_context(name, left)
