"""Every file that a document names exists, and every link leads somewhere."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
TOP_FOLDERS = ("deploy", "docs", "drivers", "estimator", "examples", "service", "sim_fakes", "tests")
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
NAMED = re.compile(r"(?<![\w./-])((?:" + "|".join(TOP_FOLDERS) + r")/[\w./@*{},-]+)")


def _slug(heading: str) -> str:
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def _has_anchor(page: Path, anchor: str) -> bool:
    headings = re.findall(r"^#+ (.*)$", page.read_text("utf-8"), re.MULTILINE)
    return anchor in map(_slug, headings)


def _dead_links(page: Path) -> list[str]:
    dead = []
    for target in LINK.findall(page.read_text("utf-8")):
        path, _, anchor = target.partition("#")
        if "://" in target:
            continue
        there = (page.parent / path).resolve() if path else page
        if not there.exists() or (anchor and not _has_anchor(there, anchor)):
            dead.append(target)
    return dead


def _missing_files(text: str) -> list[str]:
    """Return the named paths of the repository that no file or folder matches."""
    outside_code_blocks = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    named = {path.rstrip(".,") for path in NAMED.findall(outside_code_blocks)}
    return sorted(path for path in named if not any(ROOT.glob(path.rstrip("/"))))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_somewhere(page: Path) -> None:
    assert _dead_links(page) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_named_file_exists(page: Path) -> None:
    assert _missing_files(page.read_text("utf-8")) == []


def test_a_moved_file_and_a_dead_link_are_noticed(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    links = "[a](#one) [b](#two) [c](gone.md)"
    page.write_text(f"# One\n{links} `service/app.py` `service/softarm/daemon/app.py`\n")
    assert _dead_links(page) == ["#two", "gone.md"]
    assert _missing_files(page.read_text()) == ["service/app.py"]


def _index_entries() -> set[str]:
    return set(LINK.findall((ROOT / "docs" / "README.md").read_text("utf-8")))


def test_the_index_lists_every_page() -> None:
    pages = {path.name for path in (ROOT / "docs").glob("*.md")} - {"README.md"}
    assert pages <= _index_entries()
