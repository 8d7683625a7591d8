from pathlib import Path

from softarm.daemon.config_page import render

PAGE = Path(__file__).parents[3] / "docs" / "configuration.md"


def test_page_is_that_of_the_models():
    assert PAGE.read_text() == render(), "run: python -m softarm.daemon.config_page > docs/configuration.md"


def test_every_key_says_what_it_means():
    rows = [line.split("|") for line in render().splitlines() if line.startswith("| `")]
    assert len(rows) > 25
    assert [cells[1] for cells in rows if not cells[4].strip()] == []
