from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.diagnosis.base_weight import BaseWeight
from tests.estimator.simulation.straight_arm import HEIGHTS, straight_arm, world

MASS, G = 0.08, 9.81
COMPLIANCE = 0.5
PUSHED = np.array([[0.0, 0.01, 0.0]])


def weight(gravity: list[float], strains_by_gravity: np.ndarray) -> BaseWeight:
    arm = straight_arm(np.zeros(1))
    drive = replace(arm.drive, gravity=np.array([gravity]))
    weighed = replace(world(), masses=np.array([0.0, MASS]))
    return BaseWeight.of(weighed, drive, arm.baseline, strains_by_gravity)


def test_a_rigid_pendulum_on_a_spring_rests_where_both_hold_its_moment() -> None:
    """(1 / C + m g l) r = M of one that hangs, and (1 / C - m g l) r = M of one that stands."""
    rigid, none = np.zeros((1, 8, 3)), np.zeros((1, 8, 8))
    own = COMPLIANCE * MASS * G * HEIGHTS[1]
    for gravity, factor in ((G, 1.0 + own), (-G, 1.0 - own)):
        rested = weight([0.0, 0.0, gravity], rigid).at_rest(PUSHED, COMPLIANCE, none)
        assert rested == pytest.approx(PUSHED / factor)


def test_an_arm_that_would_fall_over_stays_where_its_moment_turns_it() -> None:
    rigid, none = np.zeros((1, 8, 3)), np.zeros((1, 8, 8))
    falling = 2.0 / (MASS * G * HEIGHTS[1])
    assert weight([0.0, 0.0, -G], rigid).at_rest(PUSHED, falling, none) == pytest.approx(PUSHED)


def test_an_arm_that_gives_way_hangs_more_upright_and_holds_its_base_back_less() -> None:
    """A pendulum of mass m on a joint of stiffness c at height h, below a base on a spring.

    The joint turns by m g (l - h) r / (c + m g (l - h)) against the base's r, so that the moment about the
    base is m g l r - m g (l - h) times that.
    """
    joint, height, length = 0.4, HEIGHTS[0], HEIGHTS[1]
    lever = MASS * G * (length - height)
    stiffness = joint + lever
    by_gravity = np.zeros((1, 8, 3))
    by_gravity[0, 5, 0] = MASS * (length - height) / stiffness
    one = np.zeros((1, 8, 8))
    one[0, 5, 5] = stiffness
    held = MASS * G * length - lever * lever / stiffness
    rested = weight([0.0, 0.0, G], by_gravity).at_rest(PUSHED, COMPLIANCE, one)
    assert rested == pytest.approx(PUSHED / (1.0 + COMPLIANCE * held))
