"""The fit of a vibration where the model is not fit for it: beyond its pressures, or without a stiffness."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from softarm.estimator.diagnosis.nuisances import calibrate_sessions
from softarm.estimator.diagnosis.session import Session
from softarm.estimator.diagnosis.stage import Stage, Vibrations
from softarm.estimator.diagnosis.vibration import (
    LONGEST_STEP,
    OTHER_ARM,
    Vibration,
    fit_vibration,
    with_vibration,
)
from softarm.estimator.effects import EFFECTS, Spot
from softarm.estimator.effects.effect import ModalChange
from softarm.estimator.effects.placed import PlacedEffect
from softarm.estimator.simulation.inertia import Masses, StrainDynamics, VibratingArm
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.linear_arm import model, session
from tests.estimator.simulation.straight_arm import straight_arm, world

MASSES = Masses(np.array([0.02, 0.023]), np.array([0.16, 0.082]))


@pytest.fixture(scope="module")
def stage() -> Stage:
    """A stage whose samples are near enough to show a vibration."""
    slow = session("run", 0)
    quick = replace(slow, clock=slow.clock[0] + 0.5 * (slow.clock - slow.clock[0]))
    assert quick.step <= LONGEST_STEP
    return calibrate_sessions(model(), [quick]).stage(model(), quick)


def with_compliance(stage: Stage, factor: float, samples: slice) -> Stage:
    """Multiply the compliance at some samples."""
    baseline = stage.arm.baseline
    jacobian = baseline.input_jacobian.copy()
    jacobian[samples, :, baseline.chambers : -3] *= factor
    return replace(stage, arm=replace(stage.arm, baseline=replace(baseline, input_jacobian=jacobian)))


def test_an_unstable_stretch_does_not_unsettle_the_vibration(stage: Stage) -> None:
    unstable = with_compliance(stage, -1.0, slice(60, 120))
    _, notes = fit_vibration([unstable], MASSES)
    assert not any("no vibration was fitted" in note for note in notes)
    vibration = Vibration(1.0, (2.0, 0.002), 0.03, 0.1, 2.0)
    usual = np.abs(with_vibration(stage, vibration, MASSES).drive.couples).max()
    assert np.abs(with_vibration(unstable, vibration, MASSES).drive.couples).max() < 10.0 * usual


@pytest.mark.parametrize("factor", [np.nan, -1.0, 0.0], ids=["unknown", "unstable", "rigid"])
def test_no_vibration_is_fitted_without_a_stiffness(stage: Stage, factor: float) -> None:
    vibration, notes = fit_vibration([with_compliance(stage, factor, slice(None))], MASSES)
    assert vibration is None
    assert notes == ("run: no vibration was fitted, since the model's stiffness is not known along it.",)


def test_a_vibration_is_found_with_its_mass_and_its_delay(stage: Stage) -> None:
    truth = Vibration(0.7, (2.0, 0.002), 0.06, 0.0, 0.0)
    vibrated = with_vibration(stage, truth, MASSES)
    moved = np.einsum(
        "trk,tk->tr", stage.couple_jacobian, vibrated.drive.couples.reshape(stage.session.samples, -1)
    )
    recorded = replace(stage, session=replace(stage.session, readings=stage.base + moved))
    vibration, (note,) = fit_vibration([recorded], MASSES)
    assert vibration is not None
    assert vibration.mass == pytest.approx(truth.mass, rel=0.15)
    assert vibration.delay == pytest.approx(truth.delay, abs=0.5 * stage.session.step)
    assert vibration.relative_error < 0.2
    assert f"{vibration.mass:.2f} times the weighed masses" in note


@pytest.fixture(scope="module")
def calm(stage: Stage) -> Stage:
    """The same with pressures so low that the arm answers in proportion."""
    low = replace(stage.session, pressures=0.05 * stage.session.pressures)
    return calibrate_sessions(model(), [stage.session]).stage(model(), low)


def vibrating(stage: Stage, masses: Masses, damping: float = 0.002) -> tuple[Stage, np.ndarray]:
    """Let a stage vibrate; return it, and what that changes of its predictions."""
    found = with_vibration(stage, Vibration(1.0, (2.0, damping), 0.03, 0.1, 2.0), masses)
    couples = found.drive.couples.reshape(stage.session.samples, -1)
    return found, np.einsum("trk,tk->tr", stage.couple_jacobian, couples)


def test_an_arm_that_carries_a_mass_vibrates_as_one_that_is_heavier(calm: Stage) -> None:
    payload = 0.02
    plain, light = vibrating(calm, MASSES)
    _, heavy = vibrating(calm, replace(MASSES, sections=MASSES.sections + np.array([0.0, payload])))
    carried = PlacedEffect(
        EFFECTS["tip_payload"], Spot(calm.world, Place(section="tip")), np.array([payload])
    )
    assert not calm.session.gravity.any()  # its weight changes nothing
    difference = plain.change([carried]) - (heavy - light)
    assert np.linalg.norm(difference) < 0.1 * np.linalg.norm(heavy - light)  # it has no rotary inertia
    assert np.abs(heavy - light).max() > 0.1 * np.abs(light).max()


def test_damping_of_the_whole_arm_is_that_in_proportion_to_its_stiffness(stage: Stage) -> None:
    """Where hardly any pressure changes that: the material damps as it does without pressures."""
    low = replace(stage.session, pressures=1e-3 * stage.session.pressures)
    calm = calibrate_sessions(model(), [stage.session]).stage(model(), low)
    more = 0.1
    plain, light = vibrating(calm, MASSES)
    _, damped = vibrating(calm, MASSES, damping=0.002 + more)
    effect = PlacedEffect(EFFECTS["inertia_damping"], Spot(calm.world, Place()), np.array([0.0, more]))
    assert plain.change([effect]) == pytest.approx(damped - light, abs=1e-3 * np.abs(light).max())
    assert np.abs(damped - light).max() > 0.1 * np.abs(light).max()


def test_neither_weight_nor_pressures_change_the_stiffness_of_the_material(stage: Stage) -> None:
    gravity = np.tile([2.0, 0.0, 9.81], (stage.session.samples, 1))
    none = 0.0 * stage.session.pressures

    def dynamics(session: Session) -> StrainDynamics:
        found, _ = vibrating(calibrate_sessions(model(), [stage.session]).stage(model(), session), MASSES)
        assert found.vibrations is not None
        return found.vibrations.arm.dynamics

    weighed = dynamics(replace(stage.session, gravity=gravity))
    alone = dynamics(replace(stage.session, pressures=none))
    assert np.any(weighed.stiffness != alone.stiffness)
    assert weighed.elastic == pytest.approx(alone.elastic)
    assert alone.stiffness[0] == pytest.approx(np.diag(alone.elastic))


def test_an_arm_vibrates_about_what_an_effect_changes(calm: Stage) -> None:
    plain, lag = vibrating(calm, MASSES)
    gain = PlacedEffect(EFFECTS["chamber_gain"], Spot(calm.world, Place()), np.array([-0.2]))
    still = calm.change([gain])
    assert plain.change([gain]) == pytest.approx(still - 0.2 * lag, abs=0.02 * np.abs(lag).max())


def test_an_arm_vibrates_with_all_effects_together(calm: Stage) -> None:
    payload, less = 0.02, -0.2
    plain, light = vibrating(calm, MASSES)
    _, heavy = vibrating(calm, replace(MASSES, sections=MASSES.sections + np.array([0.0, payload])))
    carried = PlacedEffect(
        EFFECTS["tip_payload"], Spot(calm.world, Place(section="tip")), np.array([payload])
    )
    gain = PlacedEffect(EFFECTS["chamber_gain"], Spot(calm.world, Place()), np.array([less]))
    still, swing = calm.change([gain]), np.linalg.norm(heavy - light)
    together = plain.change([carried, gain]) - (still + (1.0 + less) * heavy - light)
    assert np.linalg.norm(together) < 0.1 * swing  # it has no rotary inertia
    beside = plain.change([gain], beside=[carried]) - (still + less * heavy)
    assert np.linalg.norm(beside) < 0.1 * abs(less) * swing
    assert np.linalg.norm(plain.change([gain]) - (still + less * heavy)) > 0.9 * abs(less) * swing


def test_on_a_compliant_base_a_gain_scales_how_the_base_rocks_too(calm: Stage) -> None:
    less = -0.2
    plain, lag = vibrating(calm, MASSES)
    base = PlacedEffect(EFFECTS["base_compliance"], Spot(calm.world, Place()), np.array([20.0, 0.05]))
    gain = PlacedEffect(EFFECTS["chamber_gain"], Spot(calm.world, Place()), np.array([less]))
    rocked = plain.change([base])
    expected = calm.change([gain]) + less * lag + (1.0 + less) * rocked
    assert plain.change([gain, base]) == pytest.approx(expected, abs=0.02 * np.abs(lag).max())
    assert np.abs(rocked).max() > 0.1 * np.abs(lag).max()


def test_an_arm_as_much_heavier_as_stiffer_vibrates_as_before(calm: Stage) -> None:
    more = 0.4
    plain, lag = vibrating(calm, replace(MASSES, sections=np.zeros(2)), damping=0.0)
    heavier = PlacedEffect(EFFECTS["distributed_mass"], Spot(calm.world, Place()), np.array([more]))
    stiffer = [
        PlacedEffect(EFFECTS["segment_stiffness"], Spot(calm.world, Place(segment=segment)), np.array([more]))
        for segment in calm.world.segments
    ]
    rested = lag / (1.0 + more) - lag  # it vibrates about what bends it less
    vibrated = plain.change([heavier, *stiffer]) - calm.change(stiffer)
    assert vibrated == pytest.approx(rested, abs=0.02 * np.abs(lag).max())
    apart = sum(plain.change([one]) for one in (heavier, *stiffer)) - calm.change(stiffer)
    assert np.abs(apart - rested).max() > 0.1 * np.abs(lag).max()


def test_a_law_that_stiffens_the_material_lets_the_arm_vibrate_faster(calm: Stage) -> None:
    """Friction that never slips is a stiffness, beside the pose from which it starts."""
    plain, lag = vibrating(calm, MASSES)
    friction = PlacedEffect(
        EFFECTS["hysteresis"], Spot(calm.world, Place(segment="lower")), np.array([0.4, 1e3, 0.0, 1.0])
    )
    stiffer = PlacedEffect(
        EFFECTS["segment_stiffness"], Spot(calm.world, Place(segment="lower")), np.array([0.4])
    )
    changes = [plain.change([one]) for one in (friction, stiffer)]
    difference = np.diff(changes[0] - changes[1], axis=0)
    assert np.linalg.norm(difference) < 0.05 * np.linalg.norm(np.diff(changes[1], axis=0))
    assert np.abs(changes[1]).max() > 0.1 * np.abs(lag).max()


def _rocked(gravity: float, compliance: float, damping_time: float) -> tuple[np.ndarray, np.ndarray]:
    """Rock an arm with 0.08 kg at its tip on a base whose rest steps by 0.01 rad after 0.5 s.

    Returns:
        Clock, and how far the base is from its rest, both of shape (samples,).
    """
    clock = np.arange(0.0, 40.0, 0.02)
    arm = straight_arm(clock)
    heavy = Masses(np.array([0.0, 0.08]), np.zeros(2))
    every = np.ones(len(clock), dtype=bool)
    dynamics = StrainDynamics.of(arm.baseline, arm.segments, heavy, np.ones(8))
    weighed = replace(arm, drive=replace(arm.drive, gravity=np.tile([0.0, 0.0, gravity], (len(clock), 1))))
    vibrations = Vibrations(
        VibratingArm(clock, dynamics, (0.02, 0.0), 0.0, every, every), np.zeros((len(clock), 8)), weighed
    )
    turn = np.where(clock < 0.5, 0.0, 0.01)[:, None] * np.array([0.0, 1.0, 0.0])
    base = ModalChange(base_compliance=compliance, base_damping_time=damping_time)
    there = replace(world(), masses=heavy.sections)
    _, rocking = vibrations.rocked(vibrations.arm, np.zeros_like(vibrations.still), turn, base, there)
    return clock, (rocking - turn)[:, 1]


def _crossings(gravity: float) -> int:
    """Count how often the base crosses its rest after the step."""
    clock, away = _rocked(gravity, 20.0, 0.0)
    return int(np.count_nonzero(np.diff(np.sign(away[clock > 0.6]))))


def test_gravity_holds_a_hanging_arm_on_a_compliant_base_and_not_a_standing_one() -> None:
    assert _crossings(0.5) > _crossings(0.0) > _crossings(-0.5) > 0


def test_a_base_that_is_damped_more_than_it_is_heavy_creeps_to_its_rest() -> None:
    """A spring beside a damper (Kelvin and Voigt) nears its rest by exp(-t / d)."""
    damping_time = 0.5
    clock, away = _rocked(0.0, 0.1, damping_time)
    after = clock - 0.49  # the step runs straight over one window
    expected = -0.01 * np.exp(-after / damping_time)
    assert away[clock > 0.6] == pytest.approx(expected[clock > 0.6], abs=0.02 * 0.01)


def test_an_arm_that_hardly_vibrates_follows_its_compliant_base(stage: Stage) -> None:
    gravity = np.tile([2.0, 0.0, 9.81], (stage.session.samples, 1))
    weighed = calibrate_sessions(model(), [stage.session]).stage(
        model(), replace(stage.session, gravity=gravity)
    )
    quick = with_vibration(weighed, Vibration(1e-9, (2.0, 0.0), 0.0, 0.1, 2.0), MASSES)
    base = PlacedEffect(EFFECTS["base_compliance"], Spot(weighed.world, Place()), np.array([0.2, 0.01]))
    still = weighed.first_order(base)
    difference = np.abs(quick.first_order(base) - still)
    assert np.median(difference.max(axis=1)) < 0.01 * np.abs(still).max()  # steps it takes as ramps
    assert np.abs(still).max() > np.radians(1.0)


def near_limit_point(stage: Stage, softer: np.ndarray) -> Stage:
    """Soften the arm of a stage in its slowest mode, by a factor for each sample."""
    arm, baseline = stage.arm, stage.arm.baseline
    dynamics = StrainDynamics.of(baseline, arm.segments, MASSES, np.ones(8))
    pairs = zip(dynamics.stiffness, dynamics.mass, strict=True)
    mode = np.stack([eigh(stiffness, mass)[1][:, :1] for stiffness, mass in pairs])
    rows = arm.segments.rows(baseline.frames).reshape(len(softer), 8, -1)
    share = mode @ np.swapaxes(mode, 1, 2) @ dynamics.mass @ rows @ baseline.input_jacobian
    further = baseline.load_jacobian @ np.swapaxes(rows, 1, 2) @ dynamics.stiffness @ share
    jacobian = baseline.input_jacobian + (softer - 1.0)[:, None, None] * further
    return replace(stage, arm=replace(arm, baseline=replace(baseline, input_jacobian=jacobian)))


def test_inertia_bounds_what_an_effect_changes_near_a_limit_point_wherever_it_is_seen(calm: Stage) -> None:
    gain = PlacedEffect(EFFECTS["chamber_gain"], Spot(calm.world, Place()), np.array([-0.2]))
    samples = np.arange(calm.session.samples)
    soft = near_limit_point(calm, 1.0 + 300.0 * np.exp(-(((samples - 60) / 6.0) ** 2)))
    limited, _ = vibrating(soft, MASSES)
    bent = np.full((len(samples), 2, 4), [0.2, -0.2, 0.1, 0.0])
    seen = limited.moved(bent)
    at_rest, usual = (np.abs(one.change([gain])).max() for one in (soft, vibrating(calm, MASSES)[0]))
    moving, moved = (np.abs(replace(limited, observed=one).change([gain])).max() for one in (None, seen))
    assert at_rest > 30.0 * usual
    assert max(moving, moved) < 5.0 * usual


def test_the_assumed_error_grows_with_the_compliance_and_no_fit_minds_an_unstable_sample(calm: Stage) -> None:
    scale = np.full(calm.suite.size, 1e-3)
    soft = near_limit_point(calm, np.where(np.arange(calm.session.samples) == 60, 100.0, 1.0))
    assert soft.compliance[60] > 10.0
    assert np.delete(soft.compliance, 60) == pytest.approx(np.delete(calm.compliance, 60), rel=0.02)
    squares = soft.error_std(scale) ** 2 - soft.model_error_std**2
    assert squares == pytest.approx((scale * soft.compliance[:, None]) ** 2)
    limited, _ = vibrating(with_compliance(calm, -1.0, slice(60, 61)), MASSES)
    assert limited.error_std(scale)[60].min() > 1e3 * limited.error_std(scale)[59].max()
    assert np.isnan(limited.residual[60]).all()


def test_samples_that_are_far_apart_show_no_vibration(stage: Stage) -> None:
    session = stage.session
    slow = replace(
        stage, session=replace(session, clock=session.clock[0] + 2.0 * (session.clock - session.clock[0]))
    )
    assert fit_vibration([slow], MASSES) == (None, ())
    assert with_vibration(slow, Vibration(1.0, (2.0, 0.002), 0.03, 0.1, 2.0), MASSES) is slow


def test_where_the_model_finds_no_equilibrium_nothing_vibrates(stage: Stage) -> None:
    baseline = stage.arm.baseline
    lost = replace(baseline, converged=np.zeros_like(baseline.converged))
    nowhere = replace(stage, arm=replace(stage.arm, baseline=lost))
    assert with_vibration(nowhere, Vibration(1.0, (2.0, 0.002), 0.03, 0.1, 2.0), MASSES) is nowhere


def test_the_vibration_of_an_arm_that_may_have_changed_is_less_certain(stage: Stage) -> None:
    vibration = Vibration(1.0, (2.0, 0.002), 0.03, 0.1, 2.0)
    same, other = (with_vibration(stage, vibration, MASSES, other=other) for other in (False, True))
    assert same.vibration_error_std is not None
    assert other.vibration_error_std == pytest.approx(OTHER_ARM * same.vibration_error_std)
    assert same.vibration_error_std.max() > 0.0
    assert other.base == pytest.approx(same.base)
