import re
import shutil
import subprocess
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from softarm.daemon.config import load_config

DEPLOY = Path(__file__).parents[2] / "deploy"
UNITS = sorted((DEPLOY / "systemd").glob("*.service"))
SERVICE = (DEPLOY / "systemd" / "softarm@.service").read_text()


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


def test_no_right_is_given_that_nothing_uses():
    unused = (
        "LimitMEMLOCK",
        "LogsDirectory",
        "RuntimeDirectory=",
        "mlockall",
        "SOFTARM_CACHE",
    )
    assert [word for word in unused if word in SERVICE] == []


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_a_mistake_in_the_configuration_is_not_tried_again(unit):
    assert "\nRestartPreventExitStatus=2\n" in unit.read_text()


def test_venting_fits_into_the_time_that_systemd_gives_also_on_vtem(tmp_path):
    text = (DEPLOY / "config" / "sopra.toml").read_text()
    path = tmp_path / "sopra.toml"
    path.write_text(text.replace("festo_mpa", "festo_vtem").replace("watchdog_ms = 180", "watchdog_ms = 200"))
    stop_s = float(re.search(r"^TimeoutStopSec=(\d+)$", SERVICE, re.M)[1])
    for device in load_config(path).devices:
        timing = getattr(device.build(), "supervisor", None)
        if timing is not None and device.kind == "festo_vtem":
            longest_s = timing.timing.open_s + timing.timing.identify_s + timing.timing.close_s
            assert 30.0 < longest_s < stop_s - 5.0
            return
    pytest.fail("the configuration has no VTEM terminal")


def test_example_configuration_is_valid_and_named_by_its_file(tmp_path, monkeypatch):
    path = tmp_path / "left-arm.toml"
    path.write_text((DEPLOY / "config" / "sopra.toml").read_text())
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/softarm/left-arm")
    setup = load_config(path)
    assert {device.name for device in setup.devices} == {"valves", "qtm", "gauge", "bend"}
    assert setup.config.arm == "left-arm"
    assert setup.config.state_directory == Path("/var/lib/softarm/left-arm")
    assert setup.config.recording_directory == Path("/var/lib/softarm/left-arm/recordings")


def test_credentials_of_the_unit_are_used(tmp_path, monkeypatch):
    path = tmp_path / "arm.toml"
    path.write_text((DEPLOY / "config" / "sopra.toml").read_text())
    assert load_config(path).config.network.zenoh_config is None
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    (tmp_path / "zenoh.json5").write_text("{}")
    assert load_config(path).config.network.zenoh_config == tmp_path / "zenoh.json5"
    assert "LoadCredential=zenoh.json5:" in SERVICE


def install(root, *arguments, check=True, **environment):
    return subprocess.run(
        [DEPLOY / "install", *arguments],
        env={"SOFTARM_ROOT": str(root), "PATH": "/usr/bin:/bin", **environment},
        capture_output=True,
        text=True,
        check=check,
    )


def test_install_is_idempotent_and_keeps_what_belongs_to_the_laboratory(tmp_path):
    assert "softarm@.service" in install(tmp_path, "sopra").stdout
    kept = [tmp_path / "etc/softarm/sopra.toml", tmp_path / "etc/udev/rules.d/70-softarm.rules"]
    for file in kept:
        file.write_text("# mine\n")
    assert install(tmp_path, "sopra").stdout == ""
    assert [file.read_text() for file in kept] == ["# mine\n"] * 2


def test_two_arms_on_one_host_have_ports_of_their_own(tmp_path):
    for name in ("left", "right", "third"):
        install(tmp_path, name)
    found = [load_config(tmp_path / f"etc/softarm/{name}.toml").config for name in ("left", "right", "third")]
    assert [config.network.listen[0] for config in found] == [
        f"tcp/127.0.0.1:{port}" for port in (7447, 7448, 7449)
    ]
    assert [config.page.port for config in found] == [8080, 8081, 8082]


def test_the_units_follow_the_prefix(tmp_path):
    install(tmp_path, "left", SOFTARM_PREFIX="/srv/arms")
    for unit in (tmp_path / "etc/systemd/system").iterdir():
        assert "/srv/arms/venv/bin/softarm" in unit.read_text()
        assert "/opt/softarm" not in unit.read_text()


def test_uninstall_keeps_the_configuration_and_with_the_last_arm_removes_the_units(tmp_path):
    install(tmp_path, "left")
    install(tmp_path, "right")
    install(tmp_path, "--uninstall", "left")
    assert (tmp_path / "etc/softarm/left.toml.removed").exists()
    assert (tmp_path / "etc/systemd/system/softarm@.service").exists()
    install(tmp_path, "--uninstall", "right")
    assert list((tmp_path / "etc/systemd/system").iterdir()) == []
    missing = install(tmp_path, "--uninstall", "right", check=False)
    assert missing.returncode == 1
    assert "no arm right is installed" in missing.stderr


@pytest.mark.parametrize(
    "arguments", [(), ("a b",), ("../x",), ("one", "two"), ("--wheel",), ("--what", "x")]
)
def test_wrong_use_prints_the_usage(arguments, tmp_path):
    wrong = install(tmp_path, *arguments, check=False)
    assert wrong.returncode == 2
    assert wrong.stderr.startswith("usage: sudo deploy/install")
    assert list(tmp_path.iterdir()) == []


def test_the_lock_of_the_installer_is_that_part_of_the_lock_which_runs_beside_an_arm():
    spec = spec_from_file_location("lock", DEPLOY / "lock.py")
    lock = module_from_spec(spec)
    spec.loader.exec_module(lock)
    text = (DEPLOY / "requirements.lock").read_text()
    assert text == lock.runtime_lock(), "run: python deploy/lock.py > deploy/requirements.lock"
    named = {match.lower() for match in re.findall(r"^([\w.-]+)==", text, re.M)}
    assert {"numpy", "numba", "eclipse-zenoh", "viser"} <= named
    assert named.isdisjoint(
        {"pytest", "mypy", "ruff", "selenium", "hypothesis", "distributed", "pysindy", "qtm-rt"}
    )
