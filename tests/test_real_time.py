"""Tests that fail on a machine that does not keep time run again, and only there."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CONFTEST = """
from pathlib import Path
from tests import real_time
from tests.real_time import in_real_time, pytest_runtest_logstart, pytest_runtest_makereport

real_time.PRESSURE = Path(__file__).with_name("pressure")
real_time.PRESSURE.write_text("some total=0")

def pytest_collection_modifyitems(items):
    for item in items:
        item.add_marker("realtime")
        in_real_time(item)
"""
TEST = """
import time
from pathlib import Path

attempts = []

def test_a_deadline():
    attempts.append(time.monotonic())
    pressure = Path(__file__).with_name("pressure")
    # some program waited for ten seconds during this attempt, or for none
    pressure.write_text(f"some total={{len(attempts) * {waited_s}e6:.0f}}")
    assert len(attempts) > {failures}, "late"
"""


@pytest.mark.parametrize(
    ("waited_s", "failures", "outcome"),
    [
        (10, 2, "1 passed, 2 rerun"),
        (10, 3, "1 skipped, 2 rerun"),
        (0, 1, "1 failed"),
        (0, 0, "1 passed"),
    ],
)
def test_a_failure_counts_where_the_machine_keeps_time(tmp_path, waited_s, failures, outcome):
    (tmp_path / "conftest.py").write_text(CONFTEST)
    (tmp_path / "test_late.py").write_text(TEST.format(waited_s=waited_s, failures=failures))
    options = f"-q -rs -p no:cacheprovider --rootdir {tmp_path} -o pythonpath={ROOT} -o markers=realtime"
    command = [sys.executable, "-m", "pytest", *options.split(), str(tmp_path)]
    printed = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    assert outcome in printed, printed
    assert ("failed 3 times, while programs waited for the processor" in printed) is (failures == 3)
