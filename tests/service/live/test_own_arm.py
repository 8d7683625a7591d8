"""An arm that is not SoPrA: three chambers in one segment, played, served and taught on real ports."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from softarm.cli.teach import command as teach
from softarm.estimator.specimen import save_specimen
from softarm.experiments.rig import FakeRig, RigSettings, free_endpoint, service_config
from softarm.experiments.session import connect, wait_ready
from tests.sim_fakes.arms import three_chambers

DEVICES = (
    {"name": "valves", "kind": "festo_mpa", "host": "127.0.0.1", "port": 502, "valve_map": (0, 1, 2)},
    {"name": "qtm", "kind": "qualisys", "host": "127.0.0.1", "port": 22223, "sections": ("base", "tip")},
    {"name": "bend", "kind": "bendlabs", "path": "/dev/ttyACM0", "sections": ("tip",)},
)


def test_the_configuration_fits_the_arm_of_the_specimen(tmp_path: Path) -> None:
    save_specimen(three_chambers(), tmp_path / "tri.toml")
    settings = RigSettings("demo", specimen=str(tmp_path / "tri.toml"), sensors=("orientation", "bend"))
    table = service_config(settings, DEVICES)
    valves, _, bend = table["devices"]
    assert (valves["chambers"], valves["maximum_pa"]) == ([0, 1, 2], 50e3)
    assert bend["sensors"] == 1
    assert [(sensor["kind"], sensor["section"]) for sensor in table["sensors"]] == [
        ("orientation", "tip"),
        ("bend", "tip"),
    ]
    assert table["base_body"] == "qtm/base"


@pytest.mark.slow
@pytest.mark.realtime
@pytest.mark.timeout(300)
def test_an_own_arm_is_taught_a_pose_and_goes_to_it(tmp_path: Path) -> None:
    save_specimen(three_chambers(), tmp_path / "tri.toml")
    settings = RigSettings(
        "demo", specimen=str(tmp_path / "tri.toml"), arm="tri", endpoint=free_endpoint(), patience=10.0
    )
    with FakeRig(settings, tmp_path / "rig") as rig:
        with connect(rig) as client:
            assert wait_ready(client).mode == "IDLE"
        words = ["--arm", "tri", "--endpoint", settings.endpoint]
        saved = CliRunner().invoke(teach, ["save", *words, "left"], input="\n" * 4)
        assert saved.exit_code == 0, saved.output
        assert "The pose can be reached." in saved.output
        went = CliRunner().invoke(teach, ["goto", *words, "left", "--seconds", "1"])
        assert went.exit_code == 0, went.output
