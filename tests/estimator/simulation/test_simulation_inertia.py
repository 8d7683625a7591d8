import numpy as np
import pytest

from softarm.estimator.simulation.inertia import Masses, StrainDynamics, VibratingArm
from tests.estimator.simulation.straight_arm import HEIGHTS, SEGMENTS, STIFFNESS, straight_arm

ELASTIC = STIFFNESS.ravel()
TIP = Masses(np.array([0.0, 0.08]), np.zeros(2))
TIME = np.arange(0.0, 4.0, 0.01)


def dynamics(masses, samples=1):
    return StrainDynamics.of(straight_arm(np.zeros(samples)).baseline, SEGMENTS, masses, ELASTIC)


def oscillator(frequency, samples):
    """One strain that vibrates at a frequency [Hz]."""
    one, stiffness = np.ones((samples, 1, 1)), (2 * np.pi * frequency) ** 2
    every = np.ones(len(one), dtype=bool)
    return StrainDynamics(stiffness * one, one, one, one[:, None], every, np.array([stiffness]))


def test_a_tip_mass_vibrates_at_its_frequency():
    levers = HEIGHTS[1] - np.array([0.065, 0.20])
    compliance = (levers**2 / STIFFNESS[:, 0]).sum()
    expected = 1.0 / (2 * np.pi * np.sqrt(TIP.sections[1] * compliance))
    found = dynamics(TIP).frequencies()
    assert found[:2] == pytest.approx([expected, expected], rel=0.01)  # its gyration counts a little


def test_a_compliant_base_yields_in_series_with_the_arm():
    compliance = 10.0
    levers = HEIGHTS[1] - np.array([0.065, 0.20])
    whole = (levers**2 / STIFFNESS[:, 0]).sum() + compliance * HEIGHTS[1] ** 2
    expected = 1.0 / (2 * np.pi * np.sqrt(TIP.sections[1] * whole))
    weightless = np.zeros((1, 8, 2)), np.zeros((1, 2, 2))
    rocking = dynamics(TIP).on_a_base(compliance, 0.0, *weightless)
    assert rocking.frequencies()[:2] == pytest.approx([expected, expected], rel=0.01)
    assert expected < 0.9 * dynamics(TIP).frequencies()[0]
    hardly = dynamics(TIP).on_a_base(1e-6, 0.0, *weightless)
    assert hardly.frequencies()[:2] == pytest.approx(dynamics(TIP).frequencies()[:2], rel=1e-3)


def test_a_segment_that_turns_with_its_base_has_the_inertia_of_a_rod():
    # I = m L^2 / 3 about the end, by integration.
    rocking = dynamics(Masses(np.zeros(2), np.array([1.0, 0.0]))).inertia[0, :, 8:]
    assert rocking[8:, :] == pytest.approx(0.13**2 / 3 * np.eye(2), rel=0.01)


@pytest.mark.parametrize("ratio", [0.8, 1.3])
def test_an_arm_of_another_density_on_a_compliant_base_has_the_masses_of_one_made_so(ratio):
    def on_a_base(arm):
        return arm.on_a_base(1.0, 0.0, np.zeros((1, 8, 2)), np.zeros((1, 2, 2))).mass[0]

    rubber = np.array([0.1, 0.08])
    made = on_a_base(dynamics(Masses(TIP.sections, ratio * rubber)))
    changed = on_a_base(dynamics(Masses(TIP.sections, rubber)).heavier(ratio, np.zeros(2)))
    assert changed == pytest.approx(made, abs=1e-12)
    assert np.linalg.eigvalsh(changed)[0] > -1e-12


def test_a_payload_on_a_compliant_base_turns_with_it():
    # A point mass has I = m L^2 about the base.
    base = dynamics(Masses(np.zeros(2), np.zeros(2))).heavier(1.0, np.array([0.0, 0.05])).inertia[0, :, 8:]
    assert base[8:, :] == pytest.approx(0.05 * HEIGHTS[1] ** 2 * np.eye(2), rel=1e-9)


def test_heavier_masses_vibrate_slower():
    heavy = Masses(4.0 * TIP.sections, TIP.segments)
    assert dynamics(heavy).frequencies()[0] == pytest.approx(dynamics(TIP).frequencies()[0] / 2)


def test_a_segment_bent_to_an_arc_has_the_energy_of_a_uniform_arc():
    # T = 1/2 m L^2 theta'^2 / 20 for a clamped arc of small curvature, by integration.
    mass = dynamics(Masses(np.zeros(2), np.array([1.0, 0.0]))).mass[0]
    assert mass[0, 0] == pytest.approx(0.13**2 / 20, rel=0.06)


def test_a_step_rings_down_as_a_damped_oscillator():
    frequency, decay = 2.0, 1.5
    found = oscillator(frequency, len(TIME)).strains(
        TIME, np.where(TIME < 0.5, 0.0, 1.0)[:, None], (2 * decay, 0.0)
    )[:, 0]
    after = TIME - 0.495  # the step runs straight over one window
    omega = np.sqrt((2 * np.pi * frequency) ** 2 - decay**2)
    exact = 1 - np.exp(-decay * after) * (np.cos(omega * after) + decay / omega * np.sin(omega * after))
    assert np.abs(found - exact)[TIME > 0.52].max() < 0.02


def test_a_strain_with_more_inertia_and_damping_rings_down_slower():
    """With M = 1 and K = w^2: M' = 1 + a^2 w^2, decay d w^2 / 2 M'."""
    frequency, inertia_time, damping_time = 2.0, 0.06, 0.02
    square = (2 * np.pi * frequency) ** 2
    mass = 1.0 + inertia_time**2 * square
    slower = oscillator(frequency, len(TIME)).slower(np.ones(1, dtype=bool), inertia_time, damping_time)
    found = slower.strains(TIME, np.where(TIME < 0.5, 0.0, 1.0)[:, None], (0.0, 0.0))[:, 0]
    after, decay = TIME - 0.495, 0.5 * damping_time * square / mass
    omega = np.sqrt(square / mass - decay**2)
    exact = 1 - np.exp(-decay * after) * (np.cos(omega * after) + decay / omega * np.sin(omega * after))
    assert np.abs(found - exact)[TIME > 0.52].max() < 0.02


def test_a_strain_of_twice_the_stiffness_vibrates_faster_by_the_root_of_two_and_damps_as_before():
    frequency, damping = 2.0, (0.0, 0.02)
    stiffer = oscillator(frequency, len(TIME)).stiffer(np.ones(1, dtype=bool), np.full(len(TIME), 2.0))
    found = stiffer.strains(TIME, np.where(TIME < 0.5, 0.0, 1.0)[:, None], damping)[:, 0]
    square = (2 * np.pi * frequency) ** 2
    after, decay = TIME - 0.495, 0.5 * damping[1] * square
    omega = np.sqrt(2.0 * square - decay**2)
    exact = 1 - np.exp(-decay * after) * (np.cos(omega * after) + decay / omega * np.sin(omega * after))
    assert np.abs(found - exact)[TIME > 0.52].max() < 0.02


def test_only_the_chosen_strains_are_stiffer():
    usual = dynamics(TIP, samples=2)
    stiffer = usual.stiffer(np.repeat([False, True], 4), np.array([1.0, 1.5]))
    assert np.array_equal(stiffer.stiffness[0], usual.stiffness[0])
    assert np.allclose(stiffer.stiffness[1, 4:, 4:], 1.5 * usual.stiffness[1, 4:, 4:])
    assert np.array_equal(stiffer.stiffness[1, :4], usual.stiffness[1, :4])


def test_factors_on_single_entries_scale_the_stiffness_and_damp_in_proportion():
    usual, bends = dynamics(TIP), np.array([False] * 4 + [True] * 2 + [False] * 2)
    factors, times = np.ones((8, 8)), np.zeros((8, 8))
    factors[4:6, 4:6], times[4:6, 4:6] = 1.5, 1.5 * 0.2
    scaled = usual.scaled(factors, times)
    both = usual.stiffer(bends, np.array([1.5])).slower(bends, 0.0, 1.5 * 0.2)
    assert both.drag is not None
    assert scaled.drag is not None
    assert np.allclose(scaled.stiffness, both.stiffness)
    assert np.allclose(scaled.drag, both.drag)
    assert np.array_equal(scaled.damped_stiffness, usual.stiffness)


def test_only_the_chosen_strains_are_slower():
    usual = dynamics(TIP)
    slower = usual.slower(np.repeat([False, True], 4), 0.1, 0.2)
    assert slower.drag is not None
    assert np.array_equal(slower.drag[:, :4], np.zeros_like(slower.drag[:, :4]))
    assert np.allclose(slower.drag[:, 4:, 4:], 0.2 * np.diag(ELASTIC[4:]))
    assert np.allclose((slower.mass - usual.mass)[:, 4:, 4:], 0.01 * np.diag(ELASTIC[4:]))
    assert np.array_equal(slower.mass[:, :4, :4], usual.mass[:, :4, :4])


def test_without_damping_the_vibration_goes_on():
    found = oscillator(2.0, len(TIME)).strains(TIME, np.where(TIME < 0.5, 0.0, 1.0)[:, None], (0.0, 0.0))
    assert np.ptp(found[TIME > 3.0]) == pytest.approx(2.0, rel=0.02)


def test_what_rests_stays_at_rest_and_a_pause_ends_a_vibration():
    still = np.full((len(TIME), 1), 0.3)
    assert oscillator(2.0, len(TIME)).strains(TIME, still, (1.0, 0.0)) == pytest.approx(still)
    clock = np.where(TIME < 2.0, TIME, TIME + 5.0)
    stepped = np.where(TIME < 1.9, 0.0, 1.0)[:, None]
    found = oscillator(2.0, len(TIME)).strains(clock, stepped, (0.0, 0.0))
    assert found[TIME > 2.02] == pytest.approx(1.0)


def test_an_arm_whose_rest_is_known_at_no_time_does_not_vibrate():
    known = np.zeros(len(TIME), dtype=bool)
    arm = VibratingArm(TIME, oscillator(2.0, len(TIME)), (1.0, 0.0), 0.0, known, ~known)
    assert not arm.lag(np.full((len(TIME), 1), np.nan)).any()
