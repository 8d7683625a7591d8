"""What an arm remembers of a force is taken out as the force falls, and no other force changes."""

import numpy as np
import pytest

from softarm.estimator.arrays import Floats
from softarm.estimator.dynamics.force_memory import ForceMemory
from softarm.estimator.model import Load
from softarm.estimator.specimen import Value

LOADS = (
    Load("middle_x", "force", (1.0, 0.0, 0.0), "middle"),
    Load("tip_x", "force", (1.0, 0.0, 0.0), "tip"),
    Load("tip_y", "force", (0.0, 1.0, 0.0), "tip"),
    Load("tip_torque", "moment", (0.0, 0.0, 1.0), "tip"),
)
SHARE = Value(value=0.03, std=0.01)
LARGEST = np.array([0.5, 0.3, 0.4, 0.1])
SIZE, ALONG = 0.5, np.array([0.6, 0.8])


@pytest.fixture
def remembered() -> ForceMemory:
    return ForceMemory(LOADS, {"tip": SHARE})


def taken_for(force: Floats) -> Floats:
    """Return what an estimate without history takes a force on the tip for, once it was the largest."""
    tip = force[1:3] + SHARE.value * ALONG * (SIZE - ALONG @ force[1:3])
    return np.array([force[0], *tip, force[3]])


def test_a_force_that_rises_stays_as_it_is(remembered: ForceMemory) -> None:
    for size in np.linspace(0.0, 1.0, 5):
        forces, covariance = remembered.update(size * LARGEST)
        np.testing.assert_array_equal(forces, size * LARGEST)
        assert not covariance.any()


@pytest.mark.parametrize("share", [0.7, 0.2, 0.0])
def test_a_force_that_falls_is_found_again(remembered: ForceMemory, share: float) -> None:
    remembered.update(LARGEST)
    forces, covariance = remembered.update(taken_for(share * LARGEST))
    np.testing.assert_allclose(forces, share * LARGEST, atol=1e-12)
    spread = SHARE.std * (1.0 - share) * SIZE * ALONG
    np.testing.assert_allclose(covariance[1:3, 1:3], np.outer(spread, spread), atol=1e-12)
    covariance[1:3, 1:3] = 0.0
    assert not covariance.any()  # nothing is known of other sections, nor of moments


def test_a_force_across_the_largest_one_stays_as_it_is(remembered: ForceMemory) -> None:
    remembered.update(LARGEST)
    across = np.array([0.0, -0.8, 0.6, 0.0])
    left = remembered.update(np.zeros(4))[0]
    np.testing.assert_allclose(remembered.update(0.2 * across)[0] - left, 0.2 * across, atol=1e-12)


def test_a_tare_keeps_out_what_was_remembered_and_begins_anew(remembered: ForceMemory) -> None:
    """Who tares at a force finds the same force afterwards, and as certain as at first."""
    remembered.update(LARGEST)
    readings = taken_for(0.2 * LARGEST)
    tare, _ = remembered.update(readings)
    remembered.tare()
    forces, covariance = remembered.update(readings)
    np.testing.assert_allclose(forces, tare)
    assert not covariance.any()


def test_a_reset_leaves_nothing_of_the_past_and_a_lost_estimate_all(
    remembered: ForceMemory,
) -> None:
    remembered.update(LARGEST)
    remembered.update(np.full(4, np.nan))
    assert remembered.update(np.zeros(4))[0].any()
    remembered.tare()
    remembered.reset()
    assert not remembered.update(np.zeros(4))[0].any()


def test_under_pressure_the_history_of_the_forces_says_nothing(remembered: ForceMemory) -> None:
    remembered.update(LARGEST)
    falling = 0.2 * LARGEST
    for pressurised in (True, False):
        forces, covariance = remembered.update(falling, pressurised=pressurised)
        np.testing.assert_array_equal(forces, falling)
        assert not covariance.any()
