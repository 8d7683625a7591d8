"""The container file names what is there; building it needs a container engine and the network."""

import re
import tomllib
from pathlib import Path

from softarm.cli import COMMANDS

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "deploy" / "Containerfile").read_text("utf-8")
IGNORED = (ROOT / ".dockerignore").read_text("utf-8").split()


def test_everything_that_is_copied_exists_and_is_not_ignored():
    sources = re.findall(r"^COPY (\S+) ", TEXT, re.MULTILINE)
    assert sources == ["deploy/requirements.lock", "."]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    for source in (*sources, *project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]):
        assert (ROOT / source).exists()
        assert source.split("/")[0] not in IGNORED


def test_its_commands_are_commands():
    named = [*re.findall(r"host softarm (\w+)", TEXT), *re.findall(r'CMD \["(\w+)"\]', TEXT)]
    assert named == ["fakes", "demo"]
    assert set(named) <= set(COMMANDS)


def test_its_python_is_one_that_the_package_supports():
    version = re.search(r"FROM python:(3\.\d+)", TEXT)[1]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert f"Programming Language :: Python :: {version}" in project["classifiers"]
