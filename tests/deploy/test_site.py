"""The documentation as a site: every link leads somewhere, and docstrings can be read."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_site_is_built_without_a_warning(tmp_path):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", tmp_path]
    settings = ["--config-file", ROOT / "deploy/site/mkdocs.yml"]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(
        [*command, *settings], capture_output=True, text=True, check=False, env=environment, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "python" / "index.html").read_text("utf-8")
    assert "softarm_client.Arm.estimates" in page
    assert "softarm.recordings.load_recording" in page


def test_every_page_is_in_the_navigation_and_every_decision_is_listed():
    settings = (ROOT / "deploy/site/mkdocs.yml").read_text("utf-8")
    assert [page.name for page in (ROOT / "docs").glob("*.md") if f": {page.name}" not in settings] == []
    listed = (ROOT / "docs/decisions/README.md").read_text("utf-8")
    decisions = (ROOT / "docs/decisions").glob("0*.md")
    assert [page.name for page in decisions if f"({page.name})" not in listed] == []
