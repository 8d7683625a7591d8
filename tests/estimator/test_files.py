"""Files appear whole or not at all, in place of files only; TOML is read as editors write it."""

import os
from pathlib import Path

import pytest

from softarm.estimator.errors import InputError
from softarm.estimator.files import parse_toml, write_whole
from softarm.estimator.specimen import load_specimen, save_specimen


def test_a_device_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(InputError, match="pipe: is not a file"):
        write_whole({tmp_path / "first": b"", pipe: b""})
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]


def test_a_path_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    name = "x" * 300
    with pytest.raises(InputError, match=rf"{name}: cannot be written \(File name too long\)"):
        write_whole({tmp_path / name: b""})


def test_a_file_has_the_rights_that_the_user_wants(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_whole({tmp_path / "a": b"1"})
    finally:
        os.umask(before)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640


def test_a_mark_of_the_byte_order_is_no_error(tmp_path: Path) -> None:
    assert parse_toml("a.toml", "\ufeffa = 1".encode()) == {"a": 1}
    path = tmp_path / "arm.toml"
    save_specimen(load_specimen("beam"), path)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert load_specimen(path).name == "beam"
