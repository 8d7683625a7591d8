"""``softarm diagnose`` from recorded valves to what it prints and writes."""

import json
from pathlib import Path

import numpy as np
import pytest

from softarm.cli import run

STEP = 0.05


@pytest.fixture
def valve(tmp_path: Path) -> Path:
    """A valve that is 3 kPa too low while it is open, recorded without an arm."""
    rng = np.random.default_rng(3)
    held = np.repeat(rng.uniform(10e3, 60e3, 30), 80)
    held[:40] = 0.0
    time = STEP * np.arange(len(held))
    pressure = np.zeros(len(held))
    for k in range(1, len(held)):
        wanted = max(held[k - 1] - 3e3, 0.0)
        pressure[k] = pressure[k - 1] + (wanted - pressure[k - 1]) * STEP / 0.1
    pressure += rng.normal(0.0, 60.0, len(held))
    rows = [f"{t:.2f},{c:.0f},{p:.1f}" for t, c, p in zip(time, held, pressure, strict=True)]
    folder = tmp_path / "valve"
    folder.mkdir()
    (folder / "recording.csv").write_text("\n".join(["t_s,pressure_cmd_0_pa,pressure_0_pa", *rows]) + "\n")
    return folder


def test_terminal_json_and_page_hold_the_same_diagnosis(
    valve: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    written = tmp_path / "mine.toml"
    words = ["--specimen", "sopra", "--out", str(out), "--jobs", "1", "--write-specimen", str(written)]
    assert run(["diagnose", str(valve), *words]) == 0
    printed, said = capsys.readouterr()
    assert f"wrote {written} without pressure_bias, line_lag: only what was fitted to the motion" in said
    report = json.loads((out / "report.json").read_text())
    effects = {finding["effect"]: finding for finding in report["findings"]}
    bias = effects["pressure_bias"]["parameters"]["bias"]
    assert bias["value"] == pytest.approx(-3000.0, abs=300.0)
    assert f"bias {1e-3 * bias['value']:.4g} ±" in printed
    assert "kPa; removes" in printed
    assert report["heldout"]["unit"] == {}
    after = report["heldout"]["pressure_rms_pa"]["pressure_0"][1]
    assert f"to {1e-3 * after:.3g} kPa" in printed
    assert printed.rstrip().endswith(f"Report: {out / 'report.html'}")
    page = (out / "report.html").read_text()
    assert all(finding["statement"].split(".")[0] in page for finding in report["findings"])


def test_a_second_run_names_the_report_that_is_there(
    valve: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["diagnose", str(valve), "--specimen", "sopra", "--out", str(tmp_path / "out"), "--jobs", "1"]
    assert run(command) == 0
    first = capsys.readouterr().out
    assert run(command) == 0
    again = capsys.readouterr()
    assert "holds this diagnosis already" in again.err
    assert again.out.splitlines()[-1] == first.splitlines()[-1]


def test_a_specimen_of_something_else_is_not_taken_for_what_a_diagnosis_wrote(
    valve: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["diagnose", str(valve), "--specimen", "sopra", "--out", str(tmp_path / "out"), "--jobs", "1"]
    written, other = tmp_path / "mine.toml", tmp_path / "other.toml"
    other.write_text("mine = 1\n")
    assert run([*command, "--write-specimen", str(written)]) == 0
    capsys.readouterr()
    assert run([*command, "--write-specimen", str(written)]) == 0
    assert "holds this diagnosis already" in capsys.readouterr().err
    assert run([*command, "--write-specimen", str(other)]) == 2
    assert "other.toml: exists already" in capsys.readouterr().err


def test_what_was_left_out_of_a_recording_is_said(
    valve: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = valve / "recording.csv"
    lines = data.read_text().splitlines()
    lines[500] = lines[500].rsplit(",", 1)[0] + ",655350"
    data.write_text("\n".join(lines) + "\n")
    assert run(["diagnose", str(valve), "--specimen", "sopra", "--jobs", "1"]) == 0
    said = capsys.readouterr().err.splitlines()
    assert "valve: readings that cannot be true: pressure_0_pa 1 spikes; counted as lost." in said


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("given", [True, False])
def test_a_recording_that_cannot_be_read_is_set_aside_wherever_it_stands(
    valve: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], *, first: bool, given: bool
) -> None:
    bad = tmp_path / "bad"
    bad.mkdir()
    (bad / "recording.csv").write_text("t_s,pressure_0_pa\n0,nonsense\n")
    (valve / "recording.toml").write_text('specimen = "sopra"\n')
    recordings = [str(bad), str(valve)] if first else [str(valve), str(bad)]
    words = ["--specimen", "sopra"] if given else []
    assert run(["diagnose", *recordings, *words, "--jobs", "1", "--json"]) == 0
    printed, said = capsys.readouterr()
    assert json.loads(printed)["recordings"] == ["valve"]
    (line,) = (line for line in said.splitlines() if "set aside" in line)
    assert line.startswith(f"{bad / 'recording.csv'}")
    assert run(["diagnose", str(bad), *words, "--jobs", "1"]) == 2


@pytest.mark.parametrize("words", [["--nominal", "--specimen", "sopra"], ["--nominal"]])
def test_nominal_needs_a_recording(words: list[str], valve: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["diagnose", str(valve), *words]) == 2
    assert "'--nominal' needs at least one recording" in capsys.readouterr().err


def test_a_recording_of_which_no_valve_can_be_judged_is_named(
    valve: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = (valve / "recording.csv").read_text().splitlines()
    short = tmp_path / "short.csv"
    short.write_text("\n".join(lines[:50]) + "\n")
    words = ["--specimen", "sopra", "--jobs", "1"]
    assert run(["diagnose", str(valve), str(short), *words]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("short: no valve can be judged; more than 50 readings of a set-point")
    assert run(["diagnose", str(short), *words]) == 2
