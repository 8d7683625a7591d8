"""Threads of linear algebra that the command line allows."""

import os
import subprocess
import sys

from softarm.cli import THREADS

CODE = """
import contextlib, softarm.cli as cli
with contextlib.suppress(SystemExit):
    cli.main(["--version"])
import scipy.linalg, threadpoolctl
print({pool["num_threads"] for pool in threadpoolctl.threadpool_info()})
"""


def _threads(**wanted: str) -> str:
    environment = {name: value for name, value in os.environ.items() if name not in THREADS} | wanted
    done = subprocess.run(
        [sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines()[-1]


def test_one_unless_told_otherwise() -> None:
    assert _threads() == "{1}"
    assert _threads(OPENBLAS_NUM_THREADS="2") == "{2}"
