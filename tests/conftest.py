"""What all tests share."""

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from threadpoolctl import threadpool_limits

from tests.real_time import in_real_time, pytest_runtest_logstart, pytest_runtest_makereport

__all__ = ["pytest_runtest_logstart", "pytest_runtest_makereport"]

LOADED = np.linalg, scipy.linalg
"""Only libraries that are loaded can be limited."""

SERVICE = Path(__file__).parent / "service"
REALTIME = (
    SERVICE / "live",
    SERVICE / "bench" / "test_soak.py",
    SERVICE.parent / "cli" / "test_tutorial_live.py",
)
COLLECTED = {*REALTIME, SERVICE / "page"}
"""All that `./run test` collects for tests in real time: other imports take long."""


def pytest_collection_modifyitems(items):
    for item in items:
        paths = {item.path, *item.path.parents}
        if paths & set(REALTIME) or (SERVICE / "page" in paths and "service" in item.fixturenames):
            item.add_marker("realtime")
        if item.get_closest_marker("realtime") is None:
            continue
        if item.get_closest_marker("slow") is None and not paths & COLLECTED:
            raise pytest.UsageError(f"{item.nodeid} keeps real time, and ./run test does not collect it so")
        in_real_time(item)


@pytest.fixture(scope="session", autouse=True)
def _one_thread():
    """More threads of linear algebra only wait for each other where cores are shared."""
    with threadpool_limits(limits=1):
        yield
