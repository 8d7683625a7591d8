"""The programs in README are those in ``examples``, which the live tests run."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text("utf-8")
PROGRAMS = re.findall(r"^```python\n(.*?)^```$", README, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("name", ["print_force.py", "teach_and_replay.py"])
def test_readme_shows_the_example_as_it_is_run(name: str) -> None:
    body = (ROOT / "examples" / name).read_text("utf-8").partition("with Arm")[2]
    assert any(
        program.partition("with Arm")[2].replace('"sopra"', "*sys.argv[1:]") == body for program in PROGRAMS
    )


def test_readme_is_short() -> None:
    written_by_hand = re.sub(r"<!-- figures: begin -->.*<!-- figures: end -->", "", README, flags=re.DOTALL)
    assert len(written_by_hand.splitlines()) <= 60
