"""What tests of several clients share."""

import pytest

from tests.service.network.served import ServedArm


@pytest.fixture
def served(tmp_path):
    """A real controller behind a real session, on stand-ins of instruments and estimator."""
    with ServedArm(tmp_path) as served:
        yield served
