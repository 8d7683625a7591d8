"""What all tests share."""

import numpy as np
import pytest
import scipy.linalg
from threadpoolctl import threadpool_limits

LOADED = np.linalg, scipy.linalg
"""Only libraries that are loaded can be limited."""


@pytest.fixture(scope="session", autouse=True)
def _one_thread():
    """More threads of linear algebra only wait for each other where cores are shared."""
    with threadpool_limits(limits=1):
        yield
