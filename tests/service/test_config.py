"""A configuration tells all of its errors at once, each with its place."""

import shutil
from pathlib import Path

import pytest

from softarm.daemon.config import ConfigError, load_config
from softarm.estimator.errors import InputError

SHIPPED = Path(__file__).parents[2] / "deploy" / "config" / "sopra.toml"
WRONG = """
arm = "my arm"
specimen = "sopra"
base_body = "cameras/base"
[network]
listn = ["tcp/127.0.0.1:7447"]
[control]
rate_hz = -5
forces_on = ["base"]
[[devices]]
name = "valves"
kind = "festo_mpaa"
[[sensors]]
kind = "pose"
section = "tipp"
device = "qtm"
"""
PLACES = (
    "arm: ",
    "network.listn: unknown key; did you mean 'listen'?",
    "control.rate_hz: ",
    "devices[0]: kind 'festo_mpaa' is unknown",
    "base_body: no device 'cameras'",
    "sensors.0.device: no device 'qtm'; there are valves",
    "sensors.0.section: no section 'tipp'; there are base, intermediate, tip",
    "control.forces_on.0: 'base' does not move",
)


def test_every_mistake_is_told_at_once_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(WRONG)
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert len(caught.value.lines) == len(PLACES), caught.value.lines
    for place in PLACES:
        assert any(line.startswith(place) for line in caught.value.lines), place
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(f"{path}: (1) ")
    assert str(caught.value).endswith("; correct them all")


def test_recordings_are_named_by_whole_paths(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copy(SHIPPED, tmp_path / "arm.toml")
    monkeypatch.chdir(tmp_path)
    config = load_config(Path("arm.toml")).config
    assert config.recording_directory == tmp_path / "recordings"
    assert config.state_directory == tmp_path / "state"


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match=r"cannot be read \(invalid start byte\); write it in UTF-8"):
        load_config(path)


def test_a_table_in_place_of_a_list_is_a_mistake_and_no_traceback(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_text('arm = "a"\nspecimen = "sopra"\nsensors = 3\n[devices]\nname = "valves"\n')
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert {line.split(":")[0] for line in caught.value.lines} == {"sensors", "devices"}
