"""The wheel alone: what it holds, and its commands away from the checkout."""

import json
import signal
import subprocess
import tomllib
from pathlib import Path

import pytest

pytestmark = pytest.mark.timeout(400)


@pytest.fixture
def command(environment, tmp_path):
    """Run a command of the installed package, without the checkout's paths."""

    def start(*arguments, **options):
        return subprocess.Popen(
            [environment / "bin" / "softarm", *arguments],
            cwd=tmp_path,
            env={"PATH": "/usr/bin:/bin", "HOME": str(tmp_path), "OPENBLAS_NUM_THREADS": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            **options,
        )

    return start


def test_the_wheel_runs_without_the_checkout_and_without_development_tools(environment, command):
    told, errors = command("--version").communicate(timeout=60)
    assert "version" in told, errors
    where = "import softarm.cli, softarm.fakes; print(softarm.cli.__file__, softarm.fakes.__file__)"
    python = environment / "bin" / "python"

    def ask(code):
        clean = {"PATH": "/usr/bin:/bin"}
        return subprocess.run([python, "-c", code], capture_output=True, text=True, check=False, env=clean)

    found = ask(where).stdout
    assert all(path.startswith(str(environment)) for path in found.split())
    for tool in ("pytest", "mypy", "selenium", "hypothesis", "distributed"):
        assert (
            subprocess.run([python, "-c", f"import {tool}"], capture_output=True, check=False).returncode == 1
        )


@pytest.mark.parametrize("scenario", ["demo", "bench", "bad_day"])
def test_fakes_start_from_a_scenario_of_the_wheel(scenario, command):
    fakes = command("fakes", "--scenario", scenario, "--json")
    try:
        line = fakes.stdout.readline()
        assert line, fakes.stderr.read()
        assert json.loads(line)["ready"]
    finally:
        fakes.send_signal(signal.SIGTERM)
        fakes.communicate(timeout=60)


def test_the_demo_starts_fakes_and_service_from_files_of_the_wheel(environment, command, tmp_path):
    demo = command("demo", "--once", "--json", "--out", "out")
    written = tmp_path / "out" / "service.toml"
    try:
        while demo.poll() is None and not written.exists():
            try:
                demo.wait(0.05)
            except subprocess.TimeoutExpired:
                continue
        assert demo.poll() is None, demo.communicate()
        specimen = tomllib.loads(written.read_text())["specimen"]
        assert Path(specimen).is_relative_to(environment)
        assert Path(specimen).is_file()
    finally:
        demo.send_signal(signal.SIGTERM)
        demo.communicate(timeout=120)


@pytest.mark.slow
def test_the_demo_of_the_wheel_measures_the_force_and_ends(command, tmp_path):
    """From an empty cache: the estimator is compiled before the experiment."""
    told, errors = command("demo", "--once", "--json", "--out", "out").communicate(timeout=380)
    rows = json.loads(told)["rows"]
    assert {row["condition"] for row in rows} == {"not pressurised", "pressurised"}, errors
    assert all(row["mean_percent"] < 2.0 for row in rows)
    assert (tmp_path / "out" / "force.png").exists()
