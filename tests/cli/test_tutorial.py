"""The offline commands of docs/tutorial.md print what the tutorial shows."""

import re
from pathlib import Path

import pytest

from softarm.cli import run

ROOT = Path(__file__).parents[2]
TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text("utf-8")
OFFLINE = TUTORIAL[TUTORIAL.index("## Part 2") :]
STEPS = re.findall(r"^```\n\$ \./run (.+)\n((?:.*\n)*?)```$", OFFLINE, re.MULTILINE)
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
TOLERANCE = 0.1
"""Relative; the last digits of an estimate may differ between processors."""


def _same(shown: str, printed: str) -> bool:
    """Compare two lines, numbers within the tolerance."""
    if NUMBER.sub("#", shown).split() != NUMBER.sub("#", printed).split():
        return False
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True)
    return all(float(theirs) == pytest.approx(float(ours), rel=TOLERANCE) for ours, theirs in pairs)


def test_the_tutorial_has_offline_steps() -> None:
    assert [command.split()[0] for command, _ in STEPS] == ["plot", "estimate", "convert", "diagnose"]


def test_a_changed_number_or_word_is_noticed() -> None:
    assert _same("bias -2.999 kPa", "bias  -3.01 kPa")
    assert not _same("bias -2.999 kPa", "bias -2.1 kPa")
    assert not _same("wrote out/a.png", "wrote out/b.png")


@pytest.mark.parametrize(("command", "shown"), STEPS, ids=lambda words: str(words).split()[0])
def test_a_command_prints_what_the_tutorial_shows(
    command: str,
    shown: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    assert run(command.split()) == 0
    captured = capsys.readouterr()
    printed = [*captured.out.splitlines(), *captured.err.splitlines()]
    expected = [line for line in shown.splitlines() if line != "..."]
    missing = [line for line in expected if not any(_same(line, candidate) for candidate in printed)]
    assert missing == []
