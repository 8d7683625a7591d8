"""Recordings of one name in different folders, and one that is given twice."""

from pathlib import Path

import pytest

from softarm.analysis.offline.inputs import distinct_names
from softarm.estimator.errors import InputError


def named(*paths: str) -> tuple[str, ...]:
    places = [Path(path) for path in paths]
    return distinct_names([place.name for place in places], places)


def test_names_that_differ_stay() -> None:
    assert named("/data/one/a", "/data/two/b") == ("a", "b")


def test_recordings_of_one_name_are_told_apart_by_their_folders() -> None:
    assert named("/t/nominal/00", "/t/questioned/00", "/t/questioned/01") == (
        "nominal/00",
        "questioned/00",
        "01",
    )
    assert named("/one/runs/00", "/two/runs/00") == ("one/runs/00", "two/runs/00")


def test_a_recording_given_twice_is_refused() -> None:
    with pytest.raises(InputError, match="is given twice"):
        named("/t/nominal/00", "/t/nominal/../nominal/00")


def test_a_folder_and_its_file_are_one_recording(tmp_path: Path) -> None:
    file = tmp_path / "run" / "recording.csv"
    file.parent.mkdir()
    file.touch()
    with pytest.raises(InputError, match="is given twice"):
        named(str(file.parent), str(file))
