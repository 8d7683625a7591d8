import json
from pathlib import Path

import pytest

from softarm.cli import run
from softarm.cli.bench import LABORATORY_BENCHMARKS, benchmarks, command
from softarm.cli.output import Pace, ProgressLines, progress, show
from softarm.common.tables import Table, as_markdown, heading, text


def test_table_prints_rows_and_notes(capsys: pytest.CaptureFixture[str]) -> None:
    show(
        Table("Forces", [{"case": "a[1]", "force_rms_n": 0.123456, "ok": True}], ("One note.",)),
        as_json=False,
    )
    printed = capsys.readouterr().out
    for words in ("Forces", "force rms N", "a[1]", "0.1235", "yes", "One note."):
        assert words in printed


@pytest.mark.parametrize(
    ("key", "written"),
    [("limit_kpa", "limit kPa"), ("tip_z_mm", "tip z mm"), ("rate_hz", "rate Hz"), ("n", "n")],
)
def test_a_heading_writes_its_unit_as_a_symbol(key: str, written: str) -> None:
    assert heading(key) == written


def test_json_has_no_nan(capsys: pytest.CaptureFixture[str]) -> None:
    show(Table("Forces", [{"force_n": float("nan"), "n": 3}]), as_json=True)
    assert json.loads(capsys.readouterr().out) == {
        "title": "Forces",
        "rows": [{"force_n": None, "n": 3}],
        "notes": [],
    }


def test_markdown_has_one_line_per_row() -> None:
    written = as_markdown(Table("Forces", [{"force_n": 0.5}, {"force_n": None}], ("Note.",)))
    assert written.splitlines() == ["**Forces**", "", "| force N |", "|---|", "| 0.5 |", "| - |", "", "Note."]


def test_markdown_of_a_table_without_rows_is_its_title_and_notes() -> None:
    assert as_markdown(Table("Forces", [], ("None was measured.",))).splitlines() == [
        "**Forces**",
        "",
        "None was measured.",
    ]


def test_several_tables_are_one_json_document(capsys: pytest.CaptureFixture[str]) -> None:
    show(Table("a", []), Table("b", []), as_json=True)
    assert [t["title"] for t in json.loads(capsys.readouterr().out)["tables"]] == ["a", "b"]


@pytest.mark.parametrize(
    ("value", "written"), [(None, "-"), (float("nan"), "-"), (1e-9, "1e-09"), ("x", "x")]
)
def test_cells(value: str | float | None, written: str) -> None:
    assert text(value) == written


def test_progress_keeps_stdout_clean(capsys: pytest.CaptureFixture[str]) -> None:
    with progress("work", 3) as advance:
        advance(3)
    assert capsys.readouterr() == ("", "")


def test_unknown_benchmark_is_one_line_and_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["bench", "nosuch"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_benchmarks_of_developers_are_there_in_a_checkout_only(tmp_path: Path) -> None:
    assert {"step", "safety"} <= benchmarks().keys()
    elsewhere = benchmarks(tmp_path)
    assert "step" in elsewhere
    assert "safety" not in elsewhere


def test_absent_benchmark_is_not_listed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(LABORATORY_BENCHMARKS, "not-there-yet", "Nothing.")
    assert run(["bench", "--help"]) == 0
    assert "not-there-yet" not in capsys.readouterr().out
    assert run(["bench", "not-there-yet"]) == 2


def test_bench_group_has_an_example() -> None:
    assert "Example: softarm bench" in (command.help or "")


def test_a_pipe_gets_a_line_every_ten_seconds_with_the_time_left(capsys: pytest.CaptureFixture[str]) -> None:
    now = [0.0]
    lines = ProgressLines("calibrating arm", 100.0, lambda: now[0])
    for _ in range(40):
        now[0] += 1.0
        lines.advance(1.0)
    told = capsys.readouterr().err.splitlines()
    assert told[0] == "calibrating arm: 10 % after 10 s, about 90 s left at this pace"
    assert told[-1] == "calibrating arm: 40 % after 40 s, about 60 s left at this pace"
    assert len(told) == 4


def test_the_first_steps_of_long_work_tell_no_time_left(capsys: pytest.CaptureFixture[str]) -> None:
    now = [0.0]
    lines = ProgressLines("calibrating arm", 1000.0, lambda: now[0])
    now[0] = 28.0
    lines.advance(1.0)
    assert capsys.readouterr().err == "calibrating arm: 0 % after 28 s\n"


def test_the_first_step_which_compiles_does_not_count_towards_the_time_left() -> None:
    now = [0.0]
    pace = Pace(100.0, lambda: now[0])
    shown = []
    for seconds in (60.0, 1.0, 1.0):
        now[0] += seconds
        pace.advance(1.0)
        shown.append(pace.left)
    assert shown == ["", "", "about 97 s left at this pace"]


def test_quick_work_on_a_pipe_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with progress("work", 3) as advance:
        advance(1)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "words",
    [
        ["doctor", "--config", "x.toml", "--seconds", "nan"],
        ["excite", "--dry-run", "--minutes", "nan"],
        ["excite", "--dry-run", "--share", "nan"],
        ["estimate", "run", "--rate", "nan"],
    ],
)
def test_no_range_holds_what_is_no_number(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(words) == 2
    assert f"'{words[-2]}': 'nan' is not a number" in capsys.readouterr().err
