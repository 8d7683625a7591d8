"""Faults planted into recordings, through the commands: corrected with a sentence, or refused in one line."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softarm.cli import run
from softarm.estimator.recording import Recording
from softarm.recordings import save_recording
from tests.estimator.intake import small_arm as arm

STEP = 0.05
Text = Callable[[bytes], bytes]


def rows(count: int) -> arm.Fault:
    """Keep the first rows."""
    return lambda recording: recording.window(np.arange(len(recording.time)) < count)


def reordered(recording: Recording) -> Recording:
    """Put the second half first."""
    order = np.roll(np.arange(len(recording.time)), len(recording.time) // 2)
    return replace(
        recording, time=recording.time[order], columns={n: v[order] for n, v in recording.columns.items()}
    )


def doubled(recording: Recording) -> Recording:
    """Write a row twice."""
    order = np.sort(np.append(np.arange(len(recording.time)), 7))
    return replace(
        recording, time=recording.time[order], columns={n: v[order] for n, v in recording.columns.items()}
    )


def without(column: str) -> arm.Fault:
    """Drop a column."""
    return lambda recording: replace(
        recording, columns={n: v for n, v in recording.columns.items() if n != column}
    )


def no_fault(recording: Recording) -> Recording:
    """Leave a recording as it is."""
    return recording


def unchanged(data: bytes) -> bytes:
    """Leave a file as it is."""
    return data


REFUSED: dict[str, tuple[arm.Fault, Text, str]] = {
    "three chambers": (arm.three_chambers, unchanged, "chambers 0, 1, 2, the specimen has 6"),
    "suction": (arm.scaled("pressure_", "_pa", -1.0), unchanged, "below that of the air"),
    "burst": (arm.scaled("pressure_", "_pa", 3.0), unchanged, "over its limit of 65"),
    "no unit of time": (arm.in_milliseconds, unchanged, "set rate_hz"),
    "one row": (rows(1), unchanged, "1 sample "),
    "order": (reordered, unchanged, "goes back"),
    "repeated": (doubled, unchanged, "repeats"),
    "half a bend": (without("bend_tip_x_rad"), unchanged, "bend_tip_x_rad: is missing"),
    "empty": (no_fault, lambda data: b"", "is empty"),
    "no text": (no_fault, lambda data: data + b"\xb5\xff\n", "has 1 cells"),
    "zero bytes": (no_fault, lambda data: data + bytes(500), "has 1 cells"),
    "semicolons": (no_fault, lambda data: data.replace(b",", b";").replace(b".", b","), "use commas"),
    "capitals": (no_fault, lambda data: data.replace(b"t_s", b"T_S"), "nearest is t_s"),
}


COMMANDS = [
    (command, name)
    for command in ("diagnose", "estimate", "calibrate")
    for name in REFUSED
    if (command, name) != ("estimate", "one row")  # which is enough for one estimate
]


@pytest.mark.parametrize(("command", "name"), COMMANDS)
def test_a_recording_that_cannot_be_used_is_refused_in_one_line(
    command: str, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fault, text, words = REFUSED[name]
    save_recording(fault(arm.small_arm(0, 14.0, ("bend",))), tmp_path / "run")
    table = tmp_path / "run" / "recording.csv"
    table.write_bytes(text(table.read_bytes()))
    out = ["--out", str(tmp_path / "out.toml")] if command == "calibrate" else []
    assert run([command, str(tmp_path / "run"), "--specimen", "sopra", *out]) == 2
    printed = capsys.readouterr()
    errors = [line for line in printed.err.splitlines() if line.startswith("softarm:")]
    assert len(errors) == 1
    assert any(word in errors[0] for word in words.split("|")), errors
    assert len(errors[0]) < 500
    assert "internal error" not in printed.err
    assert not (tmp_path / "out.toml").exists()


def spikes(recording: Recording) -> Recording:
    """Let a pressure jump to the end of its sensor's range now and then."""
    pressure = recording.columns["pressure_0_pa"].copy()
    pressure[100::400] = 655350.0
    return replace(recording, columns={**recording.columns, "pressure_0_pa": pressure})


VALVES: dict[str, tuple[arm.Fault, ...]] = {
    "kilopascals": (arm.scaled("pressure_", "_pa", 1e-3),),
    "absolute": (arm.scaled("pressure_0", "_pa", 1.0, 101325.0),),
    "milliseconds": (arm.in_milliseconds,),
    "spikes": (spikes,),
    "kilopascals and spikes": (spikes, arm.scaled("pressure_", "_pa", 1e-3)),
    "absolute and milliseconds": (arm.scaled("pressure_0", "_pa", 1.0, 101325.0), arm.in_milliseconds),
}


def valve() -> Recording:
    """Record a valve that is 3 kPa too low while it is open, without an arm."""
    rng = np.random.default_rng(3)
    held = np.repeat(rng.uniform(10e3, 60e3, 30), 80)
    held[:80] = 0.0
    pressure = np.zeros(len(held))
    for k in range(1, len(held)):
        wanted = max(held[k - 1] - 3e3, 0.0)
        pressure[k] = pressure[k - 1] + (wanted - pressure[k - 1]) * STEP / 0.1
    columns = {"pressure_cmd_0_pa": held, "pressure_0_pa": pressure + rng.normal(0.0, 60.0, len(held))}
    return Recording("valve", STEP * np.arange(len(held)), columns, {"specimen": "sopra", "rate_hz": 20.0})


@pytest.mark.parametrize("name", VALVES)
def test_a_fault_that_is_corrected_changes_no_finding(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = valve()
    for fault in VALVES[name]:
        recording = fault(recording)
    save_recording(recording, tmp_path / "valve")
    assert run(["diagnose", str(tmp_path / "valve"), "--jobs", "1", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    findings = {finding["effect"]: finding for finding in report["findings"]}
    assert findings["pressure_bias"]["parameters"]["bias"]["value"] == pytest.approx(-3000.0, abs=300.0)
    corrected = {"frame_mismatch"} if name != "spikes" else set()
    assert set(findings) <= {"pressure_bias", "line_lag", *corrected}
    assert corrected <= set(findings)
