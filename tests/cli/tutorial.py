"""The steps of docs/tutorial.md: each a command, and what it prints."""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text("utf-8")
BLOCK = re.compile(r"^```\n\$ (.+)\n((?:.*\n)*?)```$", re.MULTILINE)
PROMPT = re.compile(r"^(.*\]):(?: (.*))?$")
"""A question with its default in brackets, and what the reader types."""


@dataclass(frozen=True)
class Step:
    """A command of the tutorial.

    Args:
        command: As written.
        shown: The lines that the tutorial shows below it.
    """

    command: str
    shown: tuple[str, ...]

    @property
    def name(self) -> str:
        """The command of softarm, or the file of an example."""
        first, second, *_ = self.command.split()
        return second if first == "./run" else Path(second).name

    @property
    def prompts(self) -> tuple[tuple[str, str], ...]:
        """Questions that the command asks, with their answers."""
        found = map(PROMPT.match, self.shown)
        return tuple((match[1], match[2] or "") for match in found if match)

    @property
    def answers(self) -> str:
        """What the reader types."""
        return "".join(f"{answer}\n" for _, answer in self.prompts)

    @property
    def printed(self) -> tuple[str, ...]:
        """The lines that are shown whole."""
        return tuple(line for line in self.shown if line != "..." and not PROMPT.match(line))


def steps(part: int) -> list[Step]:
    """List the steps of a part of the tutorial."""
    text = TUTORIAL.split("\n## ")[part]
    assert text.startswith(f"Part {part}:")
    return [Step(command, tuple(shown.splitlines())) for command, shown in BLOCK.findall(text)]
