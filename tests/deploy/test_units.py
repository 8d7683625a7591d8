import re
import shutil
import subprocess
from pathlib import Path

import pytest

from softarm.daemon.config import load_config

DEPLOY = Path(__file__).parents[2] / "deploy"
UNITS = sorted((DEPLOY / "systemd").glob("*.service"))


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_unit_is_hardened(unit):
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("systemd-analyze is not installed")
    told = subprocess.run(
        [analyze, "security", "--offline=true", unit], capture_output=True, text=True, check=False
    ).stdout
    exposure = float(re.search(r"exposure level for \S+: ([\d.]+)", told).group(1))
    assert exposure <= 2.0


def test_example_configuration_is_valid(tmp_path):
    path = tmp_path / "sopra.toml"
    path.write_text((DEPLOY / "config" / "sopra.toml").read_text())
    setup = load_config(path)
    assert {device.name for device in setup.devices} == {"valves", "qtm", "gauge", "bend"}


def test_install_is_idempotent_and_keeps_the_configuration(tmp_path):
    def install():
        return subprocess.run(
            [DEPLOY / "install", "sopra"],
            env={"SOFTARM_ROOT": str(tmp_path), "PATH": "/usr/bin:/bin"},
            capture_output=True,
            text=True,
            check=True,
        ).stdout

    assert "softarm@.service" in install()
    config = tmp_path / "etc/softarm/sopra.toml"
    config.write_text("# mine\n")
    assert install() == ""
    assert config.read_text() == "# mine\n"
