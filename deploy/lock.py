"""Print the locked versions of what runs beside an arm: requirements.lock without the development tools.

Run it from the root of the repository: python deploy/lock.py > deploy/requirements.lock
"""

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
EXTRAS = ("page", "fakes")
"""The operator page, and the fakes for ``softarm demo``."""
BLOCK = re.compile(r"^([A-Za-z0-9][\w.-]*)==.*?(?=^[A-Za-z0-9]|\Z)", re.M | re.S)
VIA = re.compile(r"^ +#(?: +via)? +([\w.-]+)(?: \(.*\))?$", re.M)


def canonical(name: str) -> str:
    """Return a package's name as the index spells it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def runtime_lock() -> str:
    """Return the part of the lock that the package and the extras need, directly or through others."""
    blocks = [
        (canonical(match[1]), match[0]) for match in BLOCK.finditer((ROOT / "requirements.lock").read_text())
    ]
    needed = _direct()
    while True:
        more = {
            name
            for name, text in blocks
            if name not in needed and any(canonical(parent) in needed for parent in VIA.findall(text))
        }
        if not more:
            return "".join(text for name, text in blocks if name in needed)
        needed |= more


def _direct() -> set[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    listed = [*project["dependencies"], *(entry for extra in EXTRAS for entry in extras[extra])]
    return {canonical(re.split(r"[^\w.-]", entry)[0]) for entry in listed}


if __name__ == "__main__":
    sys.stdout.write(runtime_lock())
