"""What all commands share: a JSON form of what they print, and the exit statuses of the documentation."""

import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from softarm import cli
from softarm.estimator.specimen import load_specimen, save_specimen

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "command-line.md").read_text("utf-8")
WITHOUT_TABLE = {"serve", "page", "ros", "vent", "bench measured", "bench reference", "bench trial"}


def leaves(group: click.Group, names: tuple[str, ...] = ()) -> Iterator[tuple[str, click.Command]]:
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from leaves(command, (*names, name))
        else:
            yield " ".join((*names, name)), command


def test_every_command_that_prints_a_table_prints_it_as_json() -> None:
    without = {
        name
        for name, command in leaves(cli.softarm)
        if not any("--json" in option.opts for option in command.params)
    }
    assert without == WITHOUT_TABLE


def test_the_page_names_the_commands_without_json() -> None:
    sentence = re.search(r"Without `--json`: (.*)\.", PAGE)
    assert sentence is not None
    assert set(re.findall(r"`(.+?)`", sentence[1])) == WITHOUT_TABLE


def statuses() -> set[int]:
    return {int(number) for number in re.findall(r"^\| (\d+) \|", PAGE, re.MULTILINE)}


def test_the_exit_statuses_are_those_of_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("softarm_client.session.CONNECT_MS", 100)
    example = ROOT / "examples" / "recordings" / "sopra_pull"
    found = {
        cli.run(["check", "sopra"]),
        cli.run(["status", "--arm", "nobody", "--endpoint", "tcp/127.0.0.1:1"]),
        cli.run(["check", "missing.toml"]),
        interrupted(monkeypatch, ["convert", str(example), "x.mcap"]),
    }
    assert found == statuses() == {0, 1, 2, 130}
    assert "Traceback" not in capsys.readouterr().err


def interrupted(monkeypatch: pytest.MonkeyPatch, arguments: list[str]) -> int:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(cli.softarm, "main", interrupt)
        return cli.run(arguments)


def test_an_interrupted_specimen_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "arm.toml"
    save_specimen(load_specimen("sopra"), path)
    before = path.read_bytes()

    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("os.fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        save_specimen(load_specimen("beam"), path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_no_help_shows_a_layout_mark_or_joins_two_examples() -> None:
    for name, command in leaves(cli.softarm):
        shown = command.get_help(click.Context(command, info_name=f"softarm {name}"))
        assert "\\b" not in shown, name
        assert not re.search(r"Example:.*Example:", shown), name


def test_wrong_use_names_the_help_to_read(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["bogus"]) == 2
    assert capsys.readouterr().err == "softarm: No such command 'bogus'. See softarm --help.\n"
    assert cli.run(["estimat"]) == 2
    assert "No such command 'estimat', did you mean 'estimate'? See" in capsys.readouterr().err
    assert cli.run(["doctor"]) == 2
    assert "--discover ADDRESS. See softarm doctor --help." in capsys.readouterr().err
    assert cli.run(["status"]) == 2
    assert "See softarm status --help." in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ["demo", "--port", "70000"],
        ["page", "--arm", "sopra", "--port", "70000"],
        ["doctor", "--discover", "127.0.0.1:70000"],
        ["serve", "--config", "sopra.toml", "--speed", "0"],
        ["diagnose", "run", "--seed", "-1"],
    ],
)
def test_a_number_out_of_range_is_wrong_use(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words[-1] in line or "1 to 65535" in line


@pytest.mark.parametrize(
    "words", [["diagnose", "run", "--out"], ["plot", "run", "-o"], ["estimate", "run", "--plots"]]
)
def test_a_folder_that_cannot_be_written_is_refused_first(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("os.access", lambda path, mode: path != tmp_path)  # root may write everywhere
    for place, what in ((tmp_path / "new", "cannot be written to"), (Path("/dev/null"), "is not a folder")):
        assert cli.run([*words, str(place)]) == 2
        assert what in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ["diagnose", "run", "--out", "file"],
        ["plot", "run", "--out", "file"],
        ["estimate", "run", "--plots", "file"],
        ["demo", "--out", "file"],
        ["experiment", "force", "--fake", "--out", "file"],
        ["excite", "--fake", "--out", "file"],
        ["excite", "--dry-run", "--plot", "file/plan.png"],
        ["bench", "diagnosis", "--trials", ".", "--out", "file"],
        ["check", "sopra", "--plot", "folder"],
    ],
)
def test_a_place_for_outputs_that_is_taken_is_named_in_one_line(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    assert cli.run(words) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("softarm: ")
    assert "file" in said or "folder" in said
    assert "internal error" not in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]
