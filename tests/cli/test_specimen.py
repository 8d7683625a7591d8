"""``softarm specimen``: asks for measures, refuses what does not fit, draws, and writes what others read."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from softarm.cli import run
from softarm.cli.specimen import command
from softarm.estimator.specimen import load_specimen


def test_measures_that_are_asked_for_become_a_specimen_and_a_picture(tmp_path: Path) -> None:
    out = tmp_path / "arm.toml"
    answers = "finger\n\n1\n" + "\n" * 20
    result = CliRunner().invoke(command, ["new", "--out", str(out), "--json"], input=answers)
    assert result.exit_code == 0, result.output
    arm = load_specimen(out)
    assert (arm.name, len(arm.chambers)) == ("finger", 3)
    assert out.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    assert "Length of the rigid base [mm] [10.0]" in result.stderr
    segments, _ = json.loads(result.stdout)["tables"]
    assert segments["rows"][0]["chambers"] == "0, 1, 2"


def test_a_cylinder_with_four_chambers_is_asked_for(tmp_path: Path) -> None:
    out = tmp_path / "new folder" / "arm.toml"
    answers = "trunk\ncylinder\n1\n\n\n\n\n\n4\n" + "\n" * 20
    result = CliRunner().invoke(command, ["new", "--out", str(out)], input=answers)
    assert result.exit_code == 0, result.output
    arm = load_specimen(out)
    assert (arm.geometry.kind, len(arm.chambers)) == ("cylinder", 4)


def test_a_name_that_would_be_read_as_a_shipped_specimen_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run(["specimen", "new", "--out", "sopra"]) == 2
    assert "is the name of a shipped specimen; write to sopra.toml" in capsys.readouterr().err


def test_millimetres_are_written_without_their_rounding(tmp_path: Path) -> None:
    out = tmp_path / "arm.toml"
    answers = "trunk\ncylinder\n1\n\n\n\n\n\n\n\n2.03\n" + "\n" * 20
    result = CliRunner().invoke(command, ["new", "--out", str(out)], input=answers)
    assert result.exit_code == 0, result.output
    assert "wall_m = 0.00203\n" in out.read_text()


def test_measures_that_do_not_fit_write_nothing(tmp_path: Path) -> None:
    out = tmp_path / "arm.toml"
    walls = ["finger", "", "1", *[""] * 7, "12", *[""] * 10]
    result = CliRunner().invoke(command, ["new", "--out", str(out)], input="\n".join(walls))
    assert result.exit_code != 0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("place", "nonsense", "why"),
    [
        (0, "my arm!", "'my arm!' is not a valid name: use letters, digits and _, a letter first"),
        (4, "nan", "'nan' is not a number from 0.2 to 2000 mm"),
        (4, "long", "'long' is not a number from 0.2 to 2000 mm"),
        (4, "0.12", "'0.12' is not a number from 0.2 to 2000 mm"),
        (5, "0.16", "'0.16' is not a number from 0.2 to 50000 g"),
        (14, "1.07", "'1.07' is not a number from 50 to 5000 kg/m3"),
        (15, "50000", "'50000' is not a number from 0.1 to 1000 kPa"),
    ],
)
def test_an_answer_that_cannot_be_is_asked_for_again(
    tmp_path: Path, place: int, nonsense: str, why: str
) -> None:
    out = tmp_path / "arm.toml"
    answers = ["finger", "cylinder", "1", *[""] * 20]
    answers.insert(place, nonsense)
    result = CliRunner().invoke(command, ["new", "--out", str(out)], input="\n".join(answers))
    assert result.exit_code == 0, result.output
    assert f"Error: {why}\n" in result.stderr
    assert load_specimen(out).name == "finger"


def test_a_place_that_cannot_be_written_is_refused_before_anything_is_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert run(["specimen", "new", "--out", str(tmp_path / "file" / "arm.toml")]) == 2
    assert capsys.readouterr().err == (
        f"softarm: {tmp_path / 'file'}: is not a folder; give a folder that you may write to\n"
    )
