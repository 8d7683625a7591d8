"""The fit of a vibration where the model is not fit for it: beyond its pressures, or without a stiffness."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.diagnosis.nuisances import calibrate_sessions
from softarm.estimator.diagnosis.stage import Stage
from softarm.estimator.diagnosis.vibration import LONGEST_STEP, Vibration, fit_vibration, with_vibration
from softarm.estimator.effects import EFFECTS, Spot
from softarm.estimator.effects.placed import PlacedEffect
from softarm.estimator.simulation.inertia import Masses
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.linear_arm import model, session

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


def test_no_vibration_is_fitted_without_a_stiffness(stage: Stage) -> None:
    vibration, notes = fit_vibration([with_compliance(stage, np.nan, slice(None))], MASSES)
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


def vibrating(stage: Stage, masses: Masses) -> tuple[Stage, np.ndarray]:
    """Let a stage vibrate; return it, and what that changes of its predictions."""
    found = with_vibration(stage, Vibration(1.0, (2.0, 0.002), 0.03, 0.1, 2.0), masses)
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


def test_an_arm_vibrates_about_what_an_effect_changes(calm: Stage) -> None:
    plain, lag = vibrating(calm, MASSES)
    gain = PlacedEffect(EFFECTS["chamber_gain"], Spot(calm.world, Place()), np.array([-0.2]))
    still = calm.change([gain])
    assert plain.change([gain]) == pytest.approx(still - 0.2 * lag, abs=0.02 * np.abs(lag).max())


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
