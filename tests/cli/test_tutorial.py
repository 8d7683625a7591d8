"""The offline commands of docs/tutorial.md print what the tutorial shows."""

import io
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from softarm.cli import run
from softarm.fakes.plant.__main__ import main as fake_arm
from tests.cli.tutorial import ROOT, Step, steps

RECORDINGS = steps(2)
OWN_ARM = [step for step in steps(3) if step.name in ("specimen", "-m", "calibrate", "estimate", "diagnose")]
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
TOLERANCE = 0.1
"""Relative; the last digits of an estimate may differ between processors."""


def _same(shown: str, printed: str) -> bool:
    """Compare two lines, numbers within the tolerance; ``...`` at the end stands for the rest of the line."""
    if shown.endswith(" ..."):
        return printed.startswith(shown.removesuffix("..."))
    if NUMBER.sub("#", shown).split() != NUMBER.sub("#", printed).split():
        return False
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True)
    return all(float(theirs) == pytest.approx(float(ours), rel=TOLERANCE) for ours, theirs in pairs)


@pytest.fixture
def print_as_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[[Step], None]:
    """Run a step in a folder with the examples, and compare."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")

    def check(step: Step) -> None:
        monkeypatch.setattr("sys.stdin", io.StringIO(step.answers))
        first, *words = step.command.split()
        if first == "./run":
            assert run(words) == 0
        else:
            assert words[:2] == ["-m", "softarm.fakes.plant"]
            assert CliRunner().invoke(fake_arm, words[2:]).exit_code == 0
        captured = capsys.readouterr()
        messages = captured.err.replace("]: ", "]:\n")  # a Return that is typed ends the line of a terminal
        printed = [*captured.out.splitlines(), *messages.splitlines()]
        missing = [line for line in step.printed if not any(_same(line, one) for one in printed)]
        assert missing == [], step.command
        assert [question for question, _ in step.prompts if f"{question}:" not in printed] == []

    return check


def test_the_tutorial_has_offline_steps() -> None:
    assert [step.name for step in RECORDINGS] == ["plot", "estimate", "convert", "diagnose"]
    named = ["specimen", "-m", "-m", "calibrate", "calibrate", "estimate", "diagnose"]
    assert [step.name for step in OWN_ARM] == named


def test_a_changed_number_or_word_is_noticed() -> None:
    assert _same("bias -2.999 kPa", "bias  -3.01 kPa")
    assert not _same("bias -2.999 kPa", "bias -2.1 kPa")
    assert not _same("wrote out/a.png", "wrote out/b.png")


@pytest.mark.parametrize("step", RECORDINGS, ids=lambda step: step.name)
def test_a_command_prints_what_the_tutorial_shows(step: Step, print_as_shown: Callable[[Step], None]) -> None:
    print_as_shown(step)


@pytest.mark.timeout(300)
def test_an_own_arm_is_described_calibrated_and_diagnosed(print_as_shown: Callable[[Step], None]) -> None:
    for step in OWN_ARM:
        print_as_shown(step)
