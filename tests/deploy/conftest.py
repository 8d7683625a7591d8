"""The wheel in an environment of its own, which holds nothing but the packages of the installer's lock."""

import re
import subprocess
import sys
from importlib.metadata import distribution
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SYSTEM_PYTHON = Path("/usr/bin/python3")


def same_version() -> bool:
    """Whether the system's interpreter can load what this one has installed."""
    if not SYSTEM_PYTHON.exists():
        return False
    ask = [SYSTEM_PYTHON, "-c", "import sys; print(*sys.version_info[:2])"]
    told = subprocess.run(ask, capture_output=True, text=True, check=True).stdout
    return told.split() == [str(number) for number in sys.version_info[:2]]


def locked_names() -> set[str]:
    text = (ROOT / "deploy" / "requirements.lock").read_text()
    return set(re.findall(r"^([\w.-]+)==", text, re.M))


def link_locked(site: Path) -> None:
    """Link the installed packages of the lock into another environment: installing them takes minutes."""
    for name in locked_names():
        try:
            files = distribution(name).files or []
        except ModuleNotFoundError:  # for another system
            continue
        for top in {Path(str(file)).parts[0] for file in files}:
            if top not in ("..", "__pycache__"):
                link, target = site / top, Path(str(distribution(name).locate_file(top)))
                if not link.exists():
                    link.symlink_to(target)


@pytest.fixture(scope="session")
def environment(tmp_path_factory):
    """Build the wheel and install it; returns the environment's folder."""
    folder = tmp_path_factory.mktemp("installed")
    interpreter = SYSTEM_PYTHON if same_version() else Path(sys.executable)
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    venv = folder / "prefix" / "venv"
    subprocess.run([interpreter, "-m", "venv", "--without-pip", venv], check=True)
    (site,) = venv.glob("lib/python*/site-packages")
    link_locked(site)
    (wheel,) = folder.glob("*.whl")
    pip = [sys.executable, "-m", "pip", "--python", str(venv / "bin" / "python")]
    subprocess.run(
        [*pip, "install", "--quiet", "--no-deps", "--no-index", str(wheel)], check=True, capture_output=True
    )
    return venv
