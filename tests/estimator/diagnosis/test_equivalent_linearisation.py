"""What a law of the material does to vibrations: its stiffness, its damping, and what it does besides."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from softarm.estimator.arrays import Floats
from softarm.estimator.diagnosis.equivalent_linearisation import STIFFEST, BendVibration, linearise
from softarm.estimator.effects.hysteresis import slipping

CLOCK = np.arange(0.0, 20.0, 0.08)
BOTH = np.array([True, True])


def vibration_of(amplitude: float = 0.05, clock: Floats = CLOCK) -> tuple[BendVibration, Floats, Floats]:
    """Return a vibration of 3 Hz about a slow motion, and the strains of the arm with and without it."""
    still = np.zeros((len(clock), 2, 4))
    still[..., 0] = 0.4 * np.sin(0.5 * clock)[:, None]
    vibrating = still.copy()
    vibrating[..., 0] += amplitude * np.sin(6.0 * np.pi * clock)[:, None]
    vibrating[..., 1] += amplitude * np.cos(6.0 * np.pi * clock)[:, None]
    known = np.ones(len(clock), dtype=bool)
    return BendVibration.of(clock, vibrating, still, known), vibrating, still


def test_a_segment_of_another_stiffness_is_one_to_vibrations():
    vibration, vibrating, still = vibration_of()
    softer = 1.0 / 0.8 - 1.0
    found, left = linearise(vibration, softer * vibrating, softer * still, BOTH, 0.0)
    assert [one.segment for one in found] == [0, 1]
    assert [one.stiffness_factor for one in found] == pytest.approx([0.8, 0.8])
    assert [one.damping_time for one in found] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert left == pytest.approx(softer * still, abs=1e-12)


def test_what_lags_behind_a_vibration_damps_it():
    """Strain that follows a load with the delay d is that of Kelvin and Voigt with the damping time d."""
    delay, (vibration, vibrating, _) = 0.01, vibration_of()
    change = np.zeros_like(vibrating)
    change[..., :2] = -delay * vibration.rates
    found, _ = linearise(vibration, change, np.zeros_like(change), BOTH, 0.0)
    assert found[0].damping_time == pytest.approx(delay)
    assert found[0].stiffness_factor == pytest.approx(1.0)
    gained, _ = linearise(vibration, -change, np.zeros_like(change), BOTH, -0.002)
    assert gained[0].damping_time == -0.002  # no more than what else damps the arm


def test_the_rates_of_a_sampled_vibration_are_those_of_the_vibration():
    vibration, *_ = vibration_of(clock=np.arange(0.0, 20.0, 0.05))
    inside = slice(10, -10)
    expected = 6.0 * np.pi * 0.05 * np.cos(6.0 * np.pi * np.arange(0.0, 20.0, 0.05))
    assert vibration.rates[inside, 0, 0] == pytest.approx(expected[inside], abs=0.03 * np.abs(expected).max())


def test_other_segments_and_lost_samples_take_no_part():
    vibration, vibrating, still = vibration_of()
    change = 0.25 * vibrating
    change[5] = np.nan
    vibration.bends[5] = vibration.rates[5] = 0.0
    found, left = linearise(vibration, change, 0.25 * still, np.array([False, True]), 0.0)
    assert [(one.segment, one.stiffness_factor) for one in found] == [(1, pytest.approx(0.8))]
    assert np.array_equal(left[:, 0], change[:, 0], equal_nan=True)
    known = np.arange(len(CLOCK)) != 5
    assert left[known, 1] == pytest.approx(0.25 * still[known, 1], abs=1e-12)


def test_no_law_makes_a_segment_stiffer_without_bound():
    vibration, vibrating, still = vibration_of()
    found, _ = linearise(vibration, -1.5 * vibrating, -1.5 * still, BOTH, 0.0)
    assert found[0].stiffness_factor == STIFFEST


def test_bends_are_the_first_two_strains_of_a_segment():
    vibration, vibrating, still = vibration_of()
    found, _ = linearise(vibration, vibrating, still, BOTH, 0.0)
    assert np.arange(12)[found[1].bends].tolist() == [4, 5]


@pytest.mark.parametrize("reach", [0.05, 0.2, 1.0])
def test_an_oscillator_with_friction_vibrations_as_the_equivalent_one(reach: float):
    """Against the integration of a mass on a spring beside an abrupt element (Prandtl), released at 0.1."""
    strength, clock = 0.3, np.arange(0.0, 2.0, 0.01)
    omega = 6.0 * np.pi

    def fall(_: float, state: Floats) -> list[float]:
        x, v, z = state
        sticks = abs(z) < reach or z * v < 0.0
        return [v, -(omega**2) * (x + strength * z), v if sticks else 0.0]

    exact = solve_ivp(fall, (0.0, clock[-1]), [0.1, 0.0, min(0.1, reach)], t_eval=clock, max_step=1e-3).y[0]

    loads = np.zeros((len(clock), 1, 2))
    loads[:, 0, 0] = 0.1 * np.cos(omega * clock)
    bends = slipping(loads, np.array([strength]), reach, True, np.zeros((1, 2)), np.zeros((1, 2)))
    vibrating, change = np.zeros((len(clock), 1, 4)), np.zeros((len(clock), 1, 4))
    vibrating[..., :2], change[..., :2] = loads, bends - loads
    every = np.ones(len(clock), dtype=bool)
    vibration = BendVibration.of(clock, vibrating, np.zeros_like(vibrating), every)
    (found,), _ = linearise(vibration, change, np.zeros_like(change), np.array([True]), 0.0)

    def equivalent(_: float, state: Floats) -> list[float]:
        return [state[1], -(omega**2) * found.stiffness_factor * (state[0] + found.damping_time * state[1])]

    near = solve_ivp(equivalent, (0.0, clock[-1]), [0.1, 0.0], t_eval=clock, max_step=1e-3).y[0]
    plain = 0.1 * np.cos(omega * clock)
    assert np.linalg.norm(near - exact) < 0.5 * np.linalg.norm(plain - exact)
