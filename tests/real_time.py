"""Tests in real time on a machine that does not keep it.

Linux counts for how long programs waited for a processor. Where some program waits nearly all the time, a
deadline that was missed says something about the machine and nothing about softarm. A test in real time that
fails then runs again, and is skipped with the share as the reason where it fails each time. On a machine that
keeps time a failure stays one.
"""

import time
from pathlib import Path

import pytest

PRESSURE = Path("/proc/pressure/cpu")
STARVED = 0.6
"""Share of the time in which some program waited, from which on a missed deadline says nothing.

The tests in ``service/live``, alone on two cores, make it 0.25 to 0.55 by themselves.
"""
RERUNS = 2
TIMEOUT_S = 120.0


class Waiting:
    """Measures the share of the time in which some program waited for a processor, since ``begin``."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Measure anew."""
        self._began, self._waited = time.monotonic(), _waited_s()

    @property
    def share(self) -> float:
        """The share; 0 where the system does not count it."""
        return (_waited_s() - self._waited) / max(time.monotonic() - self._began, 1e-3)

    def starved(self) -> bool:
        """Return whether programs waited for so long that deadlines say nothing."""
        return self.share > STARVED


def _waited_s() -> float:
    """Return for how long some program has waited since the system started [s]."""
    try:
        some = PRESSURE.read_text().splitlines()[0]
    except OSError:
        return 0.0
    return float(some.rpartition("total=")[2]) * 1e-6


WAITING = Waiting()


def in_real_time(item: pytest.Item) -> None:
    """Mark a test that keeps real time; each of its attempts has all the time, once its fixtures stand."""
    limit = item.get_closest_marker("timeout")
    item.add_marker(pytest.mark.timeout(limit.args[0] if limit else TIMEOUT_S, func_only=True), append=False)
    item.add_marker(pytest.mark.flaky(reruns=RERUNS, condition=WAITING.starved))


def pytest_runtest_logstart() -> None:
    """Begin to measure before each attempt."""
    WAITING.begin()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Skip a test in real time whose last attempt failed on a machine that does not keep it."""
    report = yield
    last = getattr(item, "execution_count", 0) > RERUNS
    if report.failed and last and item.get_closest_marker("realtime") and WAITING.starved():
        report.outcome = "skipped"
        waited = f"programs waited for the processor {WAITING.share:.0%} of the time"
        reason = f"failed {RERUNS + 1} times, while {waited}: {call.excinfo.value}"
        report.longrepr = (str(item.path), item.location[1] or 0, reason)
    return report
