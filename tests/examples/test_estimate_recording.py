"""The example that estimates a recording finds the pull that is in it."""

import runpy
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_the_pull_of_the_example_recording_is_found(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["", str(EXAMPLES / "recordings" / "sopra_pull"), "sopra"])
    runpy.run_path(str(EXAMPLES / "estimate_recording.py"))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4 * 8
    forces = [float(line.split()[3]) for line in lines if " tip_x " in line]
    assert max(forces) == pytest.approx(0.3, abs=0.03)
