import numpy as np
import pytest

from estimator.simulation.dynamics import judge_motion, natural_frequencies
from tests.estimator.simulation.straight_arm import HEIGHTS, STIFFNESS, straight_arm


def test_a_tip_mass_swings_at_its_frequency():
    response = straight_arm(np.zeros(1)).baseline
    mass = 0.08
    levers = HEIGHTS[1] - np.array([0.065, 0.20])
    compliance = (levers**2 / STIFFNESS[:, 0]).sum()
    stretch = (1.0 / STIFFNESS[:, 3]).sum()
    found = natural_frequencies(response, np.array([0.0, mass]))
    expected = 1.0 / (2 * np.pi * np.sqrt(mass * np.array([compliance, compliance, stretch])))
    assert found == pytest.approx(sorted(expected))


def test_a_heavier_arm_swings_slower():
    response = straight_arm(np.zeros(1)).baseline
    light = natural_frequencies(response, np.array([0.02, 0.08]))
    assert natural_frequencies(response, np.array([0.08, 0.32]))[0] == pytest.approx(light[0] / 2)


def test_slow_ramps_are_quasi_static_and_steps_are_not():
    time = np.arange(0.0, 10.0, 0.01)
    ramp, step = 0.02 * time[:, None], 0.2 * (time[:, None] > 2.0)
    slow = judge_motion(time, ramp, 7.7, 2e-3)
    fast = judge_motion(time, step, 7.7, 2e-3)
    assert not slow.matters
    assert "enough" in slow.tell()
    assert fast.matters
    assert fast.resolved
    assert "7.7 Hz" in fast.tell()


def test_samples_too_far_apart_are_named():
    time = np.arange(0.0, 10.0, 0.2)
    coarse = judge_motion(time, 0.2 * (time[:, None] > 2.0), 7.7, 2e-4)
    assert coarse.matters
    assert not coarse.resolved
    assert "too far apart" in coarse.tell()
