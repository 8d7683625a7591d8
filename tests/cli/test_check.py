"""``softarm check`` reads specimens and configurations, also the one that ``softarm fakes`` writes."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.patches import Polygon

from softarm.analysis.plots.specimen import draw_specimen
from softarm.cli import run
from tests.sim_fakes.arms import of_a_mesh_file, three_chambers


def test_a_specimen_is_listed_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "single_segment", "--plot", str(tmp_path / "arm.png"), "--json"]) == 0
    captured = capsys.readouterr()
    segments, sections = json.loads(captured.out)["tables"]
    assert [row["chambers"] for row in segments["rows"]]
    assert "tip" in [row["section"] for row in sections["rows"]]
    assert "single_segment is valid" in captured.err
    assert (tmp_path / "arm.png").read_bytes().startswith(b"\x89PNG")


def test_a_round_arm_is_drawn_round() -> None:
    arm = three_chambers()
    _, cross_section = draw_specimen(arm).axes
    body = cross_section.patches[0]
    assert isinstance(body, Polygon)
    corners = body.get_xy()
    middles = 0.5 * (corners[1:] + corners[:-1])
    nearest_m = min(np.linalg.norm(middles, axis=1)) / 1e3
    assert nearest_m == pytest.approx(arm.geometry.outer_radius_m, rel=0.02)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ('schema = "softarm.specimen/1"\nname = 3\n', "name"),
        ('specimen = "sopra"\n[control]\nrate = 3\n', "rate"),
        ("specimen = \n", "is not TOML"),
    ],
)
def test_a_file_that_is_wrong_is_refused_by_field(
    text: str, named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(text)
    assert run(["check", str(wrong)]) == 2
    told = capsys.readouterr().err
    assert "wrong.toml" in told
    assert named in told


def test_a_mesh_file_that_cannot_be_used_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    of_a_mesh_file(tmp_path)
    clamped = (
        (tmp_path / "arm.toml").read_text().replace('path = "arm.vtu"', 'path = "arm.vtu"\nclamp = "flange"')
    )
    (tmp_path / "clamped.toml").write_text(clamped)
    assert run(["check", str(tmp_path / "clamped.toml")]) == 2
    assert "flange" in capsys.readouterr().err
    (tmp_path / "arm.vtu").unlink()
    assert run(["check", str(tmp_path / "arm.toml")]) == 2
    assert "arm.vtu" in capsys.readouterr().err


def test_a_folder_is_refused_with_the_command_that_reads_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["check", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "is a folder" in line
    assert "softarm estimate" in line


def test_the_example_of_the_laboratory_is_valid(capsys: pytest.CaptureFixture[str]) -> None:
    example = Path(__file__).parents[2] / "deploy" / "config" / "sopra.toml"
    assert run(["check", str(example), "--json"]) == 0
    _, chambers, devices, sensors = json.loads(capsys.readouterr().out)["tables"]
    assert [row["limit_kpa"] for row in chambers["rows"]] == [65.0] * 6
    assert [row["device"] for row in devices["rows"]] == ["valves", "qtm", "gauge", "bend"]
    assert len(sensors["rows"]) == 5


@pytest.mark.parametrize("scenario", ["demo", "bench"])
def test_fakes_write_a_configuration_that_is_valid(
    scenario: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "out" / "service.toml"
    words = ["fakes", "--scenario", scenario, "--config", str(path)]
    command = [sys.executable, "-m", "softarm", *words, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as fakes:
        assert fakes.stdout is not None
        ready = json.loads(fakes.stdout.readline())
        fakes.send_signal(signal.SIGINT)
    assert run(["check", str(path), "--json"]) == 0
    _, _, devices, sensors = json.loads(capsys.readouterr().out)["tables"]
    assert [row["device"] for row in devices["rows"]] == [device["name"] for device in ready["devices"]]
    assert {row["measures"] for row in sensors["rows"]} == {"orientation", "bend", "gauge"}
    assert run(words) == 2
