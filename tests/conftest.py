"""What all tests share."""

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from threadpoolctl import threadpool_limits

LOADED = np.linalg, scipy.linalg
"""Only libraries that are loaded can be limited."""

REALTIME = tuple(
    Path(__file__).parent / part for part in ("service/live", "service/page", "service/bench/test_soak.py")
)


def pytest_collection_modifyitems(items):
    for item in items:
        if any(path == item.path or path in item.path.parents for path in REALTIME):
            item.add_marker("realtime")


@pytest.fixture(scope="session", autouse=True)
def _one_thread():
    """More threads of linear algebra only wait for each other where cores are shared."""
    with threadpool_limits(limits=1):
        yield
