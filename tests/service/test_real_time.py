"""A thread that runs before other programs, and what it starts, which does not."""

import os
import subprocess
import sys

import pytest

from softarm.common.real_time import POLICY

CHILD = "import os; print(os.sched_getscheduler(0))"
PROGRAM = f"""
import os, subprocess, sys
from softarm.common.real_time import raise_priority
raise_priority()
print(os.sched_getscheduler(0), flush=True)
subprocess.run([sys.executable, "-c", {CHILD!r}], check=True)
"""


def test_a_thread_runs_first_and_what_it_starts_does_not() -> None:
    words = [sys.executable, "-c", PROGRAM]
    own, child = subprocess.run(words, check=True, capture_output=True, text=True).stdout.split()
    if int(own) == os.SCHED_OTHER:
        pytest.skip("no real-time scheduling is permitted here")
    assert int(own) == POLICY
    assert int(child) == os.SCHED_OTHER
