"""An internal error ends in one line, with its traceback on request; Ctrl-C ends as shells expect."""

import errno
import io
import os
from pathlib import Path
from typing import IO

import pytest

from softarm import cli
from softarm.recordings import load


def test_an_internal_error_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(arguments: object) -> int:
        raise ZeroDivisionError("division\nby zero")

    monkeypatch.setattr(cli, "run", fail)
    monkeypatch.delenv(cli.TRACEBACK, raising=False)
    with pytest.raises(SystemExit) as ended:
        cli.main(["demo"])
    assert ended.value.code == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert "ZeroDivisionError: division by zero" in lines[0]
    monkeypatch.setenv(cli.TRACEBACK, "1")
    with pytest.raises(ZeroDivisionError):
        cli.main(["demo"])


@pytest.mark.parametrize(
    ("number", "named", "status", "words"),
    [
        (errno.ENOSPC, None, 1, "an output: No space left on device; make room on the disk"),
        (errno.ENAMETOOLONG, "x" * 300, 2, "File name too long; give a path that can be used"),
        (errno.EROFS, "/mnt/run.csv", 2, "/mnt/run.csv: Read-only file system; give a path"),
    ],
)
def test_an_output_that_cannot_be_written_is_no_internal_error(
    number: int,
    named: str | None,
    status: int,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fail(**options: object) -> None:
        raise OSError(number, os.strerror(number), named)

    monkeypatch.setattr(cli.softarm, "main", fail)
    assert cli.run(["demo"]) == status
    assert words in capsys.readouterr().err


def test_ctrl_c_is_one_line_and_status_130(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(**options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli.softarm, "main", interrupt)
    assert cli.run(["demo"]) == 130
    assert capsys.readouterr().err == "softarm: interrupted\n"


def test_an_input_that_ends_at_a_question_is_wrong_use(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO("my_arm\n"))
    assert cli.run(["specimen", "new", "--out", "arm.toml"]) == 2
    assert "softarm: standard input ended before every question was answered" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_while_a_file_is_written_leaves_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def write_half(recording: object, file: IO[bytes], attachments: object) -> None:
        file.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(load, "write_recording", write_half)
    example = Path(__file__).parents[2] / "examples" / "recordings" / "sopra_pull"
    assert cli.run(["convert", str(example), str(tmp_path / "out" / "x.mcap")]) == 130
    assert list(tmp_path.iterdir()) == []
