"""What each effect looks like: how it shows, and when it does not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import erf

from softarm.estimator.arrays import Floats
from softarm.estimator.effects import EFFECTS
from softarm.estimator.effects.hysteresis import slipping, slipping_fibres
from softarm.estimator.effects.placed import signals_of
from softarm.estimator.effects.rubber import losses, yielding
from softarm.estimator.effects.simulate import simulate_with
from softarm.estimator.rotations import exp, to_quaternions
from softarm.estimator.specimen.physics import Place
from tests.estimator.effects.effects_bench import SUITE, WORLD, drive_of, placed, run, step_drive
from tests.estimator.simulation.straight_arm import straight_arm

WEIGHTLESS = (0.0, 0.0, 0.0)


def bends(drive, *effects) -> np.ndarray:
    return run(drive, *effects).response.strains


def ramps(period: float, amplitude: float = 3e4, cycles: int = 2, samples: int = 400):
    phase = np.linspace(0.0, cycles, samples)
    pressures = np.zeros((samples, 6))
    pressures[:, 0] = amplitude * (1.0 - np.abs(1.0 - 2.0 * (phase % 1.0)))
    return drive_of(phase * period, pressures, WEIGHTLESS)


def test_creep_grows_after_a_step_by_its_law():
    drive = step_drive()
    ratio = bends(drive, placed("viscoelastic_creep", [0.2, 10.0, 0.0]))[:, 0, 1] / bends(drive)[-1, 0, 1]
    since = drive.time - drive.time[20]
    expected = 1.0 + 0.2 * (1.0 - np.exp(-since / 10.0))
    assert np.allclose(ratio[21:], expected[21:], atol=5e-3)


def test_the_strength_of_creep_is_that_of_a_maxwell_branch_which_relaxes_so():
    """A spring with a Maxwell branch of g times its modulus gives way by 1 / (1 + g) at once, by 1 later."""
    branch, relaxation, drive = 0.3, 5.0, step_drive()
    theta = [branch, relaxation * (1.0 + branch), 1.0]
    ratio = bends(drive, placed("viscoelastic_creep", theta))[:, 0, 1] / bends(drive)[-1, 0, 1]
    since = drive.time - np.mean(drive.time[19:21])  # the pressure rises between these two
    expected = 1.0 - branch / (1.0 + branch) * np.exp(-since / relaxation / (1.0 + branch))
    assert np.allclose(ratio[21:], expected[21:], atol=1e-3)


def test_creep_of_one_segment_leaves_the_other():
    pressures = np.where(np.arange(100)[:, None] > 0, [2e4, 0, 0, 2e4, 0, 0], 0.0)
    drive = drive_of(np.arange(100.0), pressures, WEIGHTLESS)
    gain = bends(drive, placed("viscoelastic_creep", [0.2, 10.0, 0.0], segment="lower")) - bends(drive)
    assert np.abs(gain[:, 0]).max() < 1e-12
    assert gain[-1, 1, 1] > 0.01


def test_an_arm_that_has_hung_under_its_weight_has_crept():
    drive = drive_of(np.arange(50.0), np.zeros((50, 6)), (4.0, 0.0, -9.0))
    crept = bends(drive, placed("viscoelastic_creep", [0.2, 10.0, 0.0]))
    assert np.abs(crept[0] - bends(drive)[0]).max() > 0.01
    assert np.allclose(crept, crept[0])


@pytest.mark.parametrize("name", ["hysteresis", "mullins_softening", "material_stiffening"])
def test_what_knows_no_rate_is_the_same_at_every_rate(name: str):
    theta = {
        "hysteresis": [0.3, 0.1, 0.0, 0.0],
        "mullins_softening": [0.3, 0.2, 0.5],
        "material_stiffening": [1.0],
    }[name]
    slow, fast = ramps(100.0), ramps(1.0)
    assert np.allclose(bends(slow, placed(name, theta)), bends(fast, placed(name, theta)), atol=1e-9)


@pytest.mark.parametrize("name", ["viscoelastic_creep", "line_lag", "inertia_damping"])
def test_what_knows_a_rate_is_not(name: str):
    theta = {"viscoelastic_creep": [0.3, 5.0, 0.0], "line_lag": [0.3], "inertia_damping": [0.0, 0.3]}[name]
    slow, fast = ramps(100.0), ramps(1.0)
    assert np.abs(bends(slow, placed(name, theta)) - bends(fast, placed(name, theta))).max() > 0.01


def test_hysteresis_opens_a_loop_that_closes():
    drive = ramps(10.0, cycles=3, samples=601)
    strain = bends(drive, placed("hysteresis", [0.3, 0.05, 0.0, 0.0]))[:, 0, 1]
    up, down = strain[250], strain[350]
    assert drive.pressures[250, 0] == pytest.approx(drive.pressures[350, 0])
    assert down - up > 0.01
    assert strain[450] == pytest.approx(up, abs=1e-4)


def test_mullins_softens_only_after_the_first_passage():
    drive = ramps(10.0, cycles=2, samples=401)
    ratio = bends(drive, placed("mullins_softening", [0.3, 0.2, 0.5]))[:, 0, 1] - bends(drive)[:, 0, 1]
    assert np.abs(ratio[:101]).max() < 1e-9
    assert ratio[250] == pytest.approx(ratio[150])
    assert ratio[150] > 0.01


def softened(path: list[tuple[float, float, float]], *theta: float) -> Floats:
    """Return what Mullins softening makes of bends and an elongation over the radius, shape (samples, 4)."""
    radius = float(WORLD.radii[0])
    strains = np.array([[[a, b, 0.0, radius * d]] * 2 for a, b, d in path])
    drive = drive_of(np.arange(float(len(path))), np.zeros((len(path), 6)))
    effect = placed("mullins_softening", list(theta))
    signals = replace(signals_of(drive, WORLD), strains=strains)
    return effect.effect.act(signals, effect.theta, effect.spot, ())[0][:, 0]


def test_mullins_softens_the_way_that_the_arm_has_bent_and_little_across():
    way = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
    along, against, across = (
        softened([*way, bend], 0.3, 0.5, 0.0)[-1] for bend in [(0.3, 0, 0), (-0.3, 0, 0), (0, 0.3, 0)]
    )
    assert along[:2] == pytest.approx(-against[:2])
    assert 0.3 / (1.0 - 0.3 * 0.7) < along[0] < 0.3 / (1.0 - 0.3 * 0.83)  # the outermost fibre loses 0.827
    assert 0.3 < across[1] < 0.3 + 0.5 * (along[0] - 0.3)


def test_isotropic_mullins_softens_alike_all_around():
    way = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
    along, across = (softened([*way, bend], 0.3, 0.5, 1.0)[-1] for bend in [(0.3, 0, 0), (0, 0.3, 0)])
    assert along[0] == pytest.approx(0.3 / (1.0 - 0.3 * erf(0.91 / 1.25) / erf(1.0)))
    assert across[1] == pytest.approx(along[0])


@pytest.mark.parametrize("isotropy", [0.0, 0.3, 1.0])
def test_mullins_softens_a_ring_as_the_sum_of_its_fibres(isotropy: float):
    """The law in 3600 fibres of a ring, on a way that turns and stretches."""
    way, strength, width = [(0.2, 0.1, 0.0), (0.8, 0.2, 0.1), (0.1, 0.5, 0.02)], 0.3, 0.5
    angle = np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False)
    fibres = np.stack([np.cos(angle), np.sin(angle), np.ones(3600)])
    own = (np.array(way) @ fibres) ** 2
    seen = (1.0 - isotropy) * own + isotropy * 2.0 * own.mean(axis=1, keepdims=True)
    largest = seen.max(axis=0)
    kept = 1.0 - strength * erf((largest - seen[-1]) / (width**2 + largest)) / erf(1.0)
    strain = softened(way, strength, width, isotropy)[-1][[0, 1, 3]] / [1.0, 1.0, WORLD.radii[0]]
    expected = np.linalg.solve((fibres * kept) @ fibres.T, fibres @ (np.array(way[-1]) @ fibres))
    assert strain == pytest.approx(expected, abs=2e-3)


def test_line_lag_vanishes_against_measured_pressures():
    drive = step_drive(dt=0.1)
    effect = placed("line_lag", [0.5])
    measured = replace(WORLD, pressures_measured=True)
    plain = bends(drive)
    arm = straight_arm(drive.time)
    assert np.abs(bends(drive, effect) - plain).max() > 0.01
    assert np.array_equal(simulate_with([effect], arm, measured, drive).response.strains, plain)


def test_stiffening_obeys_its_law():
    drive = ramps(10.0)
    free, stiff = bends(drive), bends(drive, placed("material_stiffening", [2.0]))
    assert np.allclose(stiff * (1.0 + 2.0 * losses(stiff, WORLD)), free, atol=1e-6)


def test_large_strain_weakens_a_ring_of_fibres():
    """The sums of ``losses`` against the stress of 3600 fibres of a ring."""
    radius, length, cubic = float(WORLD.radii[0]), 0.12, 0.05
    bend, stretch = 0.4, 0.006
    y = radius * np.sin(np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False))
    strain = (stretch + bend * y) / length
    stress = strain * (1.0 - cubic * strain**2)
    k = 0.75 * cubic * radius**2 / length**2
    lost = losses(np.array([[[bend, 0.0, 0.0, stretch]] * 2]), WORLD)[0, 0]
    assert (stress * y).sum() / (strain * y).sum() == pytest.approx(1.0 - k * lost[0], rel=1e-9)
    assert stress.sum() / strain.sum() == pytest.approx(1.0 - k * lost[3], rel=1e-9)


def test_an_arm_with_inertia_rings_at_its_frequency():
    frequency, time = 8.2, np.arange(0.0, 1.0, 0.002)
    pressures = np.zeros((len(time), 6))
    pressures[10:, 0] = 2e4
    drive = drive_of(time, pressures, WEIGHTLESS)
    strain = bends(drive, placed("inertia_damping", [1 / (2 * np.pi * frequency), 0.002]))[:, 0, 1]
    swing = strain - bends(drive)[-1, 0, 1]
    crossings = np.flatnonzero(np.diff(np.sign(swing[12:])) != 0)
    measured = 0.5 / (0.002 * np.diff(crossings).mean())
    assert measured == pytest.approx(frequency, rel=0.02)
    assert strain.max() > 1.7 * bends(drive)[-1, 0, 1]


def test_a_softer_segment_bends_more_whatever_the_load():
    drive = drive_of(np.arange(3.0), np.zeros((3, 6)), (1.0, 0.0, 9.7))
    effect = placed("segment_stiffness", [-0.2], segment="upper")
    ratio = bends(drive, effect)[:, 0, 1] / bends(drive)[:, 0, 1]
    assert np.allclose(ratio, 1.25)


def test_a_defect_depends_on_the_direction_of_the_bend():
    effect = placed("local_stiffness_defect", [0.5, 0.0, 1e-3], segment="upper")
    about_x = drive_of(np.arange(2.0), np.zeros((2, 6)), (0.0, 1.0, 0.0))
    about_y = drive_of(np.arange(2.0), np.zeros((2, 6)), (1.0, 0.0, 0.0))
    assert np.allclose(bends(about_x, effect)[:, 0, 0], 2.0 * bends(about_x)[:, 0, 0])
    assert np.allclose(bends(about_y, effect)[:, 0, 1], bends(about_y)[:, 0, 1])


def test_an_arm_that_is_stretched_bends_away_from_the_stiffer_side():
    stretched = drive_of(np.arange(2.0), np.zeros((2, 6)), (0.0, 0.0, 9.6))
    effect = placed("local_stiffness_defect", [0.2, 0.5 * np.pi, 1e-3], segment="upper")
    plain, bent = bends(stretched)[-1, 0], bends(stretched, effect)[-1, 0]
    radius = WORLD.radii[0]
    assert plain[3] > 0.0
    assert bent[:3] - plain[:3] == pytest.approx([0.0, 0.25 * plain[3] / radius, 0.0], abs=1e-7)
    assert bent[3] - plain[3] == pytest.approx(0.125 * plain[3])


@pytest.mark.parametrize(("modulus", "width"), [(0.44, 2.05), (0.6, 1.2), (2.5, 0.8)])
def test_a_defective_ring_strains_as_the_sum_of_its_fibres(modulus: float, width: float):
    """A bundle of fibres around a ring, those of a strip of another modulus, under an arbitrary load."""
    azimuth, count, radius = 0.9, 36000, WORLD.radii[0]
    angle = (np.arange(count) + 0.5) * 2.0 * np.pi / count - np.pi
    # Rows: elongation over the radius, the bend that makes the middle of the strip longer, that across.
    stretch = np.stack([np.ones(count), np.cos(angle), np.sin(angle)])
    moduli = np.where(np.abs(angle) < 0.5 * width, modulus, 1.0) / count
    whole, ring = stretch @ stretch.T / count, (stretch * moduli) @ stretch.T
    freely = ring[1, 1] - ring[0, 1] ** 2 / ring[0, 0]
    effect = placed("local_stiffness_defect", [1.0 - freely / whole[1, 1], azimuth, width], segment="upper")
    drive = drive_of(np.arange(2.0), np.zeros((2, 6)), (1.5, 2.5, 9.0))
    plain, bent = bends(drive)[-1, 0], bends(drive, effect)[-1, 0]

    def along_strip(strains: Floats) -> Floats:
        turn = np.array([[np.cos(azimuth), np.sin(azimuth)], [-np.sin(azimuth), np.cos(azimuth)]])
        return np.array([strains[3] / radius, *(turn @ strains[:2])])

    assert ring @ along_strip(bent) == pytest.approx(whole @ along_strip(plain), rel=1e-3, abs=1e-4)
    assert np.abs(bent - plain).max() > 0.01


GRAVITIES = [(2.0, 0.0, 9.6), (-9.81, 0.0, 0.0), (3.0, -4.0, -8.0), (0.0, 0.0, -9.81)]


@pytest.mark.parametrize("gravity", GRAVITIES)
def test_a_payload_weighs_like_a_force_in_the_direction_of_gravity(gravity):
    drive = drive_of(np.arange(2.0), np.zeros((2, 6)), gravity)
    weight = bends(drive, placed("tip_payload", [0.1], section="tip"))
    force = bends(drive, placed("external_force", [*(0.1 * np.array(gravity)), 0.0], section="tip"))
    assert np.allclose(weight, force)
    size = 0.1 * np.linalg.norm(gravity)
    falling = bends(drive, placed("external_force", [0.0, 0.0, size, 1.0], section="tip"))
    assert np.allclose(weight, falling, atol=1e-6)


def test_a_force_of_the_laboratory_turns_back_where_the_mount_is_turned():
    """The mount turns by 90 degrees about the base's y axis: gravity then pulls along -x, and x points up."""
    drive = drive_of(np.arange(2.0), np.zeros((2, 6)), (-9.81, 0.0, 0.0))
    for hanging, sideways in (
        ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        ((0.0, 1.0, 0.0), (0.0, 1.0, 0.0)),
        ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)),
    ):
        one, other = (
            placed("external_force", [*(0.1 * np.array(force)), laboratory], section="tip")
            for force, laboratory in ((hanging, 1.0), (sideways, 0.0))
        )
        assert bends(drive, one) == pytest.approx(bends(drive, other))


@pytest.mark.parametrize("stiffness", [5.0, 50.0, 500.0])
def test_contact_acts_on_one_side_and_balances(stiffness: float):
    drive = ramps(10.0)
    effect = placed("contact_obstacle", [stiffness, 0.01, 0.0], section="tip")
    done = run(drive, effect)
    assert done.settled
    frames = done.response.frames
    depth = WORLD.surface.points(frames.positions, frames.rotations)[..., 0] - 0.01
    push = -stiffness * np.maximum(depth, 0.0).sum(axis=1)
    assert np.allclose(done.drive.wrenches[..., 0].sum(axis=1), push, atol=1e-4)
    away = placed("contact_obstacle", [stiffness, 0.01, np.pi], section="tip")
    assert np.allclose(bends(drive, away), bends(drive))


def test_a_cord_pulls_to_its_side_once_taut():
    drive = ramps(10.0)
    done = run(drive, placed("tether_stiffness", [8.0, 0.01, np.pi, 0.3], section="tip"))
    assert done.settled
    cord = WORLD.origins[1] + [-0.3, 0.0, 0.0] - done.response.frames.positions[:, 1]
    length = np.linalg.norm(cord, axis=1)
    stretch = np.maximum(length - 0.31, 0.0)
    assert stretch.max() > 1e-3
    assert np.allclose(done.drive.wrenches[:, 1, :3], (8.0 * stretch / length)[:, None] * cord, atol=1e-5)
    other = placed("tether_stiffness", [8.0, 0.01, 0.0, 0.3], section="tip")
    assert np.allclose(bends(drive, other), bends(drive))


def test_a_cord_tied_far_away_pulls_along_one_direction():
    drive = ramps(10.0)
    done = run(drive, placed("tether_stiffness", [8.0, 0.01, np.pi, 50.0], section="tip"))
    stretch = np.maximum(done.response.frames.positions[:, 1, 0] - 0.01, 0.0)
    assert np.allclose(done.drive.wrenches[:, 1, 0], -8.0 * stretch, atol=0.01)
    assert np.abs(done.drive.wrenches[:, 1, 1:3]).max() < 0.01


def test_a_stretched_cord_pulls_the_arm_that_hangs_straight():
    drive = drive_of(np.arange(2.0), np.zeros((2, 6)), WEIGHTLESS)
    stiffness, stretched = 0.5, 0.02
    done = run(drive, placed("tether_stiffness", [stiffness, -stretched, 0.0, 0.3], section="tip"))
    moved = done.response.frames.positions[0, 1, 0]
    assert 0.0 < moved < stretched
    assert done.drive.wrenches[0, 1, 0] == pytest.approx(stiffness * (stretched - moved), rel=1e-2)


def test_a_yielding_base_turns_all_sections_alike():
    drive = drive_of(np.arange(2.0), np.zeros((2, 6)), (3.0, 0.0, 9.0))
    turned = run(drive, placed("base_compliance", [0.2, 0.01])).response.frames.rotations
    plain = run(drive).response.frames.rotations
    extra = turned @ np.swapaxes(plain, -1, -2)
    assert np.allclose(extra[:, 0], extra[:, 1], atol=0.01)
    assert np.abs(extra[:, 0] - np.eye(3)).max() > 0.01


def test_a_tilted_base_tilts_an_unloaded_arm_rigidly():
    drive = drive_of(np.arange(2.0), np.zeros((2, 6)), WEIGHTLESS)
    frames = run(drive, placed("base_tilt", [0.1, -0.2, 0.5])).response.frames
    assert np.allclose(frames.rotations, exp(np.array([0.1, -0.2, 0.0])))


def test_valves_cut_pressures_as_they_say():
    pressures = np.zeros((4, 6))
    pressures[:, 2] = [0.0, 1000.0, 20e3, 60e3]
    drive = drive_of(np.arange(4.0), pressures)

    def after(name: str, value: float) -> np.ndarray:
        return run(drive, placed(name, [value], chamber=2)).drive.pressures[:, 2]

    assert np.allclose(after("valve_deadband", 1500.0), [0.0, 0.0, 18.5e3, 58.5e3])
    assert np.allclose(after("pressure_saturation", 15e3), [0.0, 1000.0, 20e3, 50e3])
    assert np.allclose(after("pressure_bias", -600.0), [0.0, 400.0, 19.4e3, 59.4e3])
    assert np.allclose(after("chamber_gain", -0.1), 0.9 * pressures[:, 2])


@pytest.mark.parametrize("bias", [-600.0, 600.0])
def test_the_noise_of_a_vented_chamber_does_not_open_it(bias: float):
    """A sensor that reads 0 +- 60 Pa passes 100 Pa in one of twenty samples."""
    pressures = np.zeros((1000, 6))
    pressures[:, 2] = np.random.default_rng(3).normal(0.0, 60.0, 1000)
    drive = drive_of(0.01 * np.arange(1000.0), pressures)
    after = run(drive, placed("pressure_bias", [bias], chamber=2)).drive.pressures[:, 2]
    assert np.abs(after - pressures[:, 2]).mean() < 0.01 * abs(bias)
    opened = after[np.argsort(pressures[:, 2])]
    assert (np.diff(opened) >= 0.0).all() or bias < 0.0
    assert after.min() >= pressures.min()


def test_a_ring_that_softens_bears_the_load_of_the_linear_ring():
    """The stresses of all fibres, by e = s (1 + k s^n), sum up to the force and the moments of the load."""
    growth, exponent = 0.6, 1.3
    rng = np.random.default_rng(4)
    loads = np.column_stack([rng.uniform(-0.8, 0.8, (200, 2)), np.zeros(200), rng.uniform(-0.01, 0.01, 200)])
    radius = WORLD.radii[0]
    strains = yielding(loads[:, None], WORLD.radii[:1], np.array([growth]), exponent)[:, 0]
    angles = np.arange(12) * np.pi / 6.0
    fibres = np.column_stack([np.ones(12), np.cos(angles), np.sin(angles)])
    stretched = (strains[:, [3, 0, 1]] / [radius, 1.0, 1.0]) @ fibres.T
    stress = stretched.copy()
    for _ in range(50):  # Newton
        size = np.abs(stress)
        left = stress * (1.0 + growth * size**exponent) - stretched
        stress -= left / (1.0 + growth * (1.0 + exponent) * size**exponent)
    borne = stress @ fibres / 12.0 * [1.0, 2.0, 2.0]
    assert np.allclose(borne, loads[:, [3, 0, 1]] / [radius, 1.0, 1.0], atol=0.02)
    assert (np.abs(strains[:, :2]) >= np.abs(loads[:, :2]) - 0.05).all()


def test_a_ring_that_softens_a_little_does_so_by_the_integrals_over_it():
    """With the square of the strain (Yeoh): three quarters of k times the sums that ``losses`` gives."""
    loads = np.array([[[0.4, -0.2, 0.0, 0.005]], [[0.0, 0.3, 0.0, -0.004]]])
    growth = 1e-4
    more = yielding(loads, WORLD.radii[:1], np.array([growth]), 2.0) - loads
    one = replace(WORLD, stiffness=WORLD.stiffness[:1])
    assert np.allclose(more, 0.75 * growth * loads * losses(loads, one), rtol=1e-3, atol=1e-12)


def test_a_leak_loses_its_share_in_a_long_hold():
    drive = step_drive()
    pressure = run(drive, placed("line_leak", [0.2, 0.0, 5.0], chamber=0)).drive.pressures[:, 0]
    assert pressure[21] > 0.9 * 2e4
    assert pressure[-1] == pytest.approx(0.8 * 2e4, rel=1e-3)


def test_a_chamber_that_leaks_behind_a_narrow_line_never_reaches_its_pressure():
    """C p' = (p_in - p) / R - G p: the share 1 / (1 + R G) arrives, with time constant R C / (1 + R G)."""
    drive, lag, lost = step_drive(), 0.8, 0.2
    leaking = run(drive, placed("line_leak", [lost, lag, 0.01], chamber=0)).drive.pressures
    late = run(drive, placed("line_lag", [lag], chamber=0)).drive.pressures
    assert np.allclose(leaking[:, 0], (1.0 - lost) * late[:, 0], atol=0.01 * 2e4)
    assert np.array_equal(leaking[:, 1:], drive.pressures[:, 1:])


def test_friction_adds_to_the_stiffness_until_it_slips():
    """Bouc-Wen (Wen 1976): stiffness 1 + a after a reversal, 1 once slipping, a r carried by friction."""
    drive = ramps(10.0, cycles=2, samples=4001)
    loads, strain = (
        bends(drive, *effects)[:, 0, 1] for effects in ((), (placed("hysteresis", [0.3, 0.02, 0.0, 0.0]),))
    )
    stiffness = np.diff(loads) / np.where(np.diff(strain) == 0.0, np.inf, np.diff(strain))
    turn = int(np.argmax(loads))
    assert stiffness[1] == pytest.approx(1.3, rel=0.02)
    assert stiffness[turn - 5] == pytest.approx(1.0, rel=0.01)
    assert loads[turn] - strain[turn] == pytest.approx(0.3 * 0.02, rel=0.01)


@pytest.mark.parametrize("abrupt", [False, True])
def test_friction_knows_no_direction(abrupt: bool):
    turned = np.array([[0.6, -0.8], [0.8, 0.6]])
    rng = np.random.default_rng(4)
    loads = np.cumsum(rng.normal(0.0, 0.02, (300, 1, 2)), axis=0)

    def slipped(values: np.ndarray) -> np.ndarray:
        return slipping(values, np.array([0.4]), 0.05, abrupt, np.zeros((1, 2)), np.zeros((1, 2)))

    assert np.allclose(slipped(loads @ turned.T), slipped(loads) @ turned.T, atol=1e-8)


def test_abrupt_friction_is_elastic_until_it_stops():
    """Prandtl's element: stiffness 1 + a over the first 2 r of bend after a reversal, and 1 beyond."""
    strength, reach = 0.4, 0.05
    strain = np.concatenate([np.linspace(0.0, 0.5, 501), np.linspace(0.5, 0.0, 501)[1:]])
    since = np.where(np.arange(1001) <= 500, strain, 0.5 - strain)
    held = np.where(np.arange(1001) <= 500, np.minimum(since, reach), reach - np.minimum(since, 2.0 * reach))
    loads = np.zeros((1001, 1, 2))
    loads[:, 0, 0] = strain + strength * held
    bends = slipping(loads, np.array([strength]), reach, True, np.zeros((1, 2)), np.zeros((1, 2)))
    assert bends[:, 0, 0] == pytest.approx(strain, abs=1e-9)


@pytest.mark.parametrize("abrupt", [False, True])
@pytest.mark.parametrize("strength", [0.3, 0.9, -0.4])
def test_a_ring_of_fibres_that_slip_is_in_balance(strength: float, abrupt: bool):
    """Load less stress is what friction carries, found again from the strains fibre by fibre."""
    reach, angles = 0.05, np.arange(12) * np.pi / 6.0
    levers = np.stack([np.ones(12), np.cos(angles), np.sin(angles)], axis=-1)
    loads = np.cumsum(np.random.default_rng(4).normal(0.0, 0.01, (400, 1, 3)), axis=0)
    strains = slipping_fibres(loads, np.array([strength]), reach, abrupt, loads[0].copy(), np.zeros((1, 12)))
    held, most = np.zeros(12), 0.0
    for change, strain, load in zip(
        np.diff(strains[:, 0], axis=0), strains[1:, 0], loads[1:, 0], strict=True
    ):
        stretch = levers @ change
        if abrupt:
            held = np.clip(held + stretch, -reach, reach)
        else:
            limit = reach * np.sign(stretch)
            held = limit + (held - limit) * np.exp(-np.abs(stretch) / reach)
        assert np.diag([1.0, 0.5, 0.5]) @ (load - strain) == pytest.approx(
            strength * (held @ levers) / 12.0, abs=1e-8
        )
        most = max(most, np.abs(held).max())
    assert most > 0.5 * reach


def test_fibres_that_an_elongation_has_slipped_hold_no_bend():
    """Friction in the bend knows nothing of elongation; that of fibres is spent along the way."""
    loads = np.zeros((201, 1, 3))
    loads[:101, 0, 0], loads[101:, 0, 0] = np.linspace(0.0, 0.5, 101), 0.5
    loads[:, 0, 1] = np.linspace(0.0, 1e-3, 201)
    strains = slipping_fibres(loads, np.array([0.4]), 0.05, True, np.zeros((1, 3)), np.zeros((1, 12)))
    assert strains[100, 0, 0] == pytest.approx(0.5 - 0.4 * 0.05, abs=1e-6)
    assert np.diff(strains[50:101, 0, 1]) == pytest.approx(np.diff(loads[50:101, 0, 1]), abs=1e-9)


def test_crosstalk_bends_the_other_segment():
    done = run(step_drive(), placed("chamber_crosstalk", [0.1], segment="upper"))
    assert done.drive.pressures[-1, 3] == pytest.approx(2e3)
    assert done.drive.pressures[-1, [1, 2, 4, 5]].max() == 0.0


def test_fibres_twist_with_pressure():
    drive = drive_of(np.arange(2.0), np.full((2, 6), 1e4), WEIGHTLESS)
    extra = bends(drive, placed("fibre_twist", [1e-6], segment="lower")) - bends(drive)
    assert np.allclose(extra[:, 1], [0.0, 0.0, 0.03, 0.0], atol=1e-9)
    assert np.abs(extra[:, 0]).max() < 1e-9


@pytest.mark.parametrize(
    ("name", "theta", "expected"),
    [
        ("sensor_bias", [0.01, -0.02], lambda t, y: y + np.array([0.01, -0.02])),
        ("sensor_drift", [1e-3, 0.0], lambda t, y: y + np.outer(t, [1e-3, 0.0])),
        ("sensor_scale", [0.1], lambda t, y: 1.1 * y),
        ("frame_misalignment", [np.pi / 2], lambda t, y: np.stack([-y[:, 1], y[:, 0]], axis=1)),
        ("sensor_latency", [0.5], lambda t, y: np.concatenate([y[:1], y[:-1]])),
        ("sensor_stuck", [1.0, 30.0], lambda t, y: np.where(t[:, None] < 30.0, y, y[59])),
    ],
)
def test_a_faulty_sensor_errs_alone(name: str, theta: list[float], expected):
    drive = ramps(50.0, samples=101, cycles=1)
    plain, faulty = run(drive), run(drive, placed(name, theta, sensor="bend_tip"))
    reading = plain.readings["bend_tip"]
    assert np.allclose(faulty.readings["bend_tip"], expected(drive.time, reading), atol=1e-9)
    assert np.array_equal(faulty.readings["bend_intermediate"], plain.readings["bend_intermediate"])
    assert set(faulty.readings) == {sensor.name for sensor in SUITE.measurements}


@pytest.mark.parametrize(
    ("sensor", "name", "unit", "words"),
    [
        ("bend_tip", "yaw", "rad", "5.73 degrees off about the axis of the arm"),
        ("marker_tip1", "offset_z", "m", "100 mm off along the axis of the arm"),
    ],
)
def test_a_marker_is_off_by_a_length_along_the_arm_and_by_no_angle(sensor, name, unit, words):
    misaligned, place = EFFECTS["frame_misalignment"], Place(sensor=sensor)
    (parameter,) = misaligned.parameters
    assert (misaligned.reported(parameter, place), misaligned.unit(parameter, place)) == (name, unit)
    assert words in misaligned.sentence(np.array([0.1]), place)


def test_a_late_pose_is_that_of_before_even_through_half_a_turn():
    """A turn of half a revolution has two rotation vectors, and its quaternion two signs."""
    time, late = np.linspace(0.0, 2.0, 81), 0.06

    def pose(at: np.ndarray) -> np.ndarray:
        turned = to_quaternions(exp(np.array([1.0, 0.1, 0.0]) * (2.6 + 0.7 * at[:, None])))
        return np.concatenate([0.1 * at[:, None] * np.array([1.0, -2.0, 0.5]), turned], axis=1)

    drive = drive_of(time, np.zeros((81, 6)), WEIGHTLESS)
    signals = replace(signals_of(drive, WORLD), reading=pose(time))
    shown, _ = placed("sensor_latency", [late], sensor="bend_tip").act(signals, ())
    there, wanted = shown[5:], pose(time[5:] - late)
    assert np.allclose(there[:, :3], wanted[:, :3], atol=1e-12)
    assert np.allclose(np.abs((there[:, 3:] * wanted[:, 3:]).sum(axis=1)), 1.0, atol=1e-7)


def test_effects_act_together():
    drive = step_drive()
    both = bends(drive, placed("segment_stiffness", [0.3], segment="upper"), placed("chamber_gain", [0.3]))
    assert np.allclose(both[:, 0, :3], bends(drive)[:, 0, :3], atol=1e-6)
