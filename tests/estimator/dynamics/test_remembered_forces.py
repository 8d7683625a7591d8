"""A force that falls is less certain by what the arm remembers of the largest one."""

import numpy as np
import pytest

from softarm.estimator.dynamics.remembered_forces import RememberedForces
from softarm.estimator.model import Load

LOADS = (
    Load("middle_x", "force", (1.0, 0.0, 0.0), "middle"),
    Load("tip_x", "force", (1.0, 0.0, 0.0), "tip"),
    Load("tip_y", "force", (0.0, 1.0, 0.0), "tip"),
    Load("tip_torque", "moment", (0.0, 0.0, 1.0), "tip"),
)
SHARE = 0.03


@pytest.fixture
def remembered() -> RememberedForces:
    return RememberedForces(LOADS, {"tip": SHARE})


def test_a_force_that_rises_is_not_widened(remembered: RememberedForces) -> None:
    for size in np.linspace(0.0, 1.0, 5):
        assert not remembered.update(size * np.array([0.5, 0.3, 0.4, 0.1])).any()


def test_a_force_that_has_gone_leaves_its_share_behind_in_its_own_direction(
    remembered: RememberedForces,
) -> None:
    largest = np.array([0.5, 0.3, 0.4, 0.1])
    remembered.update(largest)
    covariance = remembered.update(np.zeros(4))
    left = SHARE * largest[1:3]
    np.testing.assert_allclose(covariance[1:3, 1:3], np.outer(left, left))
    covariance[1:3, 1:3] = 0.0
    assert not covariance.any()  # nothing is known of other sections, nor of moments


def test_what_is_remembered_grows_as_the_force_falls(remembered: RememberedForces) -> None:
    variances = [remembered.update(np.array([0.0, force, 0.0, 0.0]))[1, 1] for force in (1.0, 0.8, 0.4, 0.0)]
    assert (np.diff(variances) > 0.0).all()


def test_a_lost_estimate_and_a_tare_leave_nothing_of_the_past(remembered: RememberedForces) -> None:
    remembered.update(np.array([0.0, 1.0, 0.0, 0.0]))
    assert not remembered.update(np.full(4, np.nan)).any()
    remembered.reset()
    assert not remembered.update(np.zeros(4)).any()
