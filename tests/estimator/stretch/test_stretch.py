"""Pressures that are worth more as their chambers are stretched."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from softarm.estimator.arm import build_arm
from softarm.estimator.fem.tracking import TrackingModel, TrackingState
from softarm.estimator.fem.tracking.model import TrackingStep
from softarm.estimator.model import Frames, Inputs, Load
from softarm.estimator.rod.archive import shape_key, shipped_rod
from softarm.estimator.rod.fit import adapted
from softarm.estimator.rod.model import CalibratedRod
from softarm.estimator.rotations import exp, log
from softarm.estimator.specimen import Specimen, Value, load_specimen
from softarm.estimator.stretch import StretchedModel, StretchLaw, stretched

SECTIONS = ("base", "intermediate", "tip")
GAIN = 1.3
INPUTS = Inputs(np.array([2e4, 0.0, 1e4, 0.0, 1.5e4, 5e3]), np.array([0.05]), np.array([0.0, 0.0, 9.81]))


@pytest.fixture(scope="module")
def sopra() -> Specimen:
    plain = load_specimen("sopra")
    known = plain.calibration.model_copy(update={"stretch_gain": Value(value=GAIN)})
    return plain.model_copy(update={"calibration": known})


@pytest.fixture(scope="module")
def law(sopra: Specimen) -> StretchLaw:
    return StretchLaw.of(sopra, SECTIONS)


@pytest.fixture(scope="module")
def rest(sopra: Specimen) -> Frames:
    origins = [sopra.section(name).frame_origin_m for name in SECTIONS]
    return Frames(np.array(origins), np.tile(np.eye(3), (3, 1, 1)))


@pytest.fixture(scope="module")
def arm(sopra: Specimen) -> StretchedModel:  # type: ignore[type-arg]
    pull = Load("tip_x", "force", (1.0, 0.0, 0.0), section="tip")
    found = stretched(build_arm(sopra, [pull]), sopra)
    assert isinstance(found, StretchedModel)
    return found


@pytest.fixture(scope="module")
def state(arm: StretchedModel) -> Any:  # type: ignore[type-arg]
    found, converged = arm.solve(INPUTS, arm.rest())
    assert converged
    return found


def bent(rest: Frames, curvature: float, longer: float) -> Frames:
    """Bend the upper segment along a circle about y and lengthen it, the rigid parts tangent to its ends."""
    length = 0.12 * (1.0 + longer)
    turn = exp(np.array([0.0, curvature * length, 0.0]))
    end = np.array([quad(np.sin, 0, curvature * length)[0], 0.0, quad(np.cos, 0, curvature * length)[0]])
    middle = np.array([0.0, 0.0, 0.01]) + end / curvature + turn @ (0.0, 0.0, 0.0105)
    return Frames(np.array([rest.positions[0], middle, middle]), np.array([np.eye(3), turn, turn]))


def test_at_rest_nothing_is_stretched(law: StretchLaw, rest: Frames) -> None:
    np.testing.assert_allclose(law.stretches(rest), 0.0, atol=1e-8)


def test_on_a_circle_a_chamber_stretches_by_its_distance_from_the_axis(law: StretchLaw, rest: Frames) -> None:
    curvature, longer = 6.0, 0.05
    expected = (1.0 + longer) * (1.0 - curvature * law.starts[:3, 0]) - 1.0
    np.testing.assert_allclose(law.stretches(bent(rest, curvature, longer))[:3], expected, atol=2e-3)


def test_the_rows_are_the_derivatives(law: StretchLaw, rest: Frames) -> None:
    rng = np.random.default_rng(1)
    turned = exp(0.3 * rng.normal(size=(3, 3)))
    frames = Frames(rest.positions + 0.01 * rng.normal(size=(3, 3)), turned)

    def moved(twist: np.ndarray) -> np.ndarray:
        parts = twist.reshape(3, 6)
        return law.stretches(Frames(frames.positions + parts[:, :3], exp(parts[:, 3:]) @ turned))

    steps = 1e-6 * np.eye(18)
    numeric = np.stack([(moved(step) - moved(-step)) / 2e-6 for step in steps], axis=1)
    np.testing.assert_allclose(law.linearise(frames)[1], numeric, atol=1e-7)


def test_a_chamber_that_ends_at_no_section_is_not_stretched(sopra: Specimen, rest: Frames) -> None:
    alone = StretchLaw.of(sopra, ("base",))
    first = Frames(rest.positions[:1] + 0.01, rest.rotations[:1])
    assert not alone.stretches(first).any()
    assert not alone.linearise(first)[1].any()


def test_the_equilibrium_is_that_of_the_pressures_at_its_own_stretch(arm: StretchedModel, state: Any) -> None:  # type: ignore[type-arg]
    step = arm.linearise(state, INPUTS)
    assert step.residual_norm < 1e-5
    effective = arm.law.effective(INPUTS.pressures, arm.law.stretches(step.frames))
    plain, found = arm.model.solve(replace(INPUTS, pressures=effective), arm.rest())
    assert found
    there = arm.model.linearise(plain, replace(INPUTS, pressures=effective)).frames
    np.testing.assert_allclose(step.frames.positions, there.positions, atol=1e-7)


def test_the_response_is_the_derivative_with_pressures_that_follow(arm: StretchedModel, state: Any) -> None:  # type: ignore[type-arg]
    _, columns = arm.linearise(state, INPUTS).response(np.eye(18))
    for index, size in ((0, 20.0), (6, 1e-3)):
        change = np.zeros(7)
        change[index] = size
        ends = []
        for sign in (1.0, -1.0):
            pressures, loads = INPUTS.pressures + sign * change[:6], INPUTS.loads + sign * change[6:]
            there = Inputs(pressures, loads, INPUTS.gravity)
            step = arm.linearise(arm.solve(there, state)[0], there)
            ends.append((step.frames, step.response(np.eye(18))[0].reshape(3, 6)))
        (one, drift), (other, back) = ends
        twist = drift - back
        twist[:, :3] += one.positions - other.positions
        twist[:, 3:] += log(one.rotations @ np.swapaxes(other.rotations, -1, -2))
        np.testing.assert_allclose(
            columns[:, index], twist.ravel() / (2.0 * size), atol=1e-4 * np.abs(columns[:, index]).max()
        )


def test_tracking_finds_the_same_equilibrium(arm: StretchedModel, state: Any) -> None:  # type: ignore[type-arg]
    exact = arm.linearise(state, INPUTS).frames
    tracking = StretchedModel(TrackingModel(arm.model), arm.law)  # type: ignore[arg-type]
    tracked, found = tracking.solve(INPUTS, tracking.rest())
    assert found
    there = tracking.linearise(tracked, INPUTS).frames
    np.testing.assert_allclose(there.positions, exact.positions, atol=1e-6)


class Diverging(TrackingModel):
    """A model whose Newton steps lead nowhere."""

    def advance(self, step: TrackingStep, change: np.ndarray) -> TrackingState:
        return TrackingState(np.full_like(step.state.displacement, np.nan), step.inputs)


def test_a_search_that_diverges_ends_without_an_equilibrium(arm: StretchedModel) -> None:  # type: ignore[type-arg]
    """It used to end the process that searched."""
    lost: StretchedModel[Any, Any] = StretchedModel(Diverging(arm.model), arm.law)
    assert not lost.solve(INPUTS, lost.rest())[1]
    step = lost.linearise(TrackingState(np.full_like(lost.rest().displacement, np.nan), INPUTS), INPUTS)
    assert step.residual_norm == np.inf


def test_a_model_that_finds_its_equilibrium_is_linearised_once(
    sopra: Specimen, monkeypatch: pytest.MonkeyPatch
) -> None:
    rod = shipped(sopra)
    state, found = rod.solve(INPUTS, rod.rest())
    assert found
    calls = []
    plain = CalibratedRod.linearise
    monkeypatch.setattr(
        CalibratedRod, "linearise", lambda *given: calls.append(1) or plain(*given)  # type: ignore[func-returns-value]
    )  # fmt: skip
    step = rod.linearise(state, INPUTS)
    assert len(calls) == 1
    assert step.residual_norm < 1e-6
    effective = rod.law.effective(INPUTS.pressures, rod.law.stretches(step.frames))
    exact = rod.model.linearise(state, replace(INPUTS, pressures=effective)).frames
    np.testing.assert_allclose(step.frames.positions, exact.positions, atol=1e-8)


def test_pressures_of_another_stretch_are_out_of_balance(sopra: Specimen) -> None:
    rod = shipped(sopra)
    far = rod.linearise(rod.rest(), INPUTS)
    assert far.residual_norm > 1e-3
    nearer = rod.linearise(rod.advance(far, np.zeros(7)), INPUTS)
    assert nearer.residual_norm < 0.1 * far.residual_norm


def shipped(specimen: Specimen) -> StretchedModel:  # type: ignore[type-arg]
    """Return the shipped rod, stretched."""
    known = shipped_rod(shape_key(specimen))
    assert known is not None
    pull = Load("tip_x", "force", (1.0, 0.0, 0.0), section="tip")
    found = stretched(adapted(known.rod, specimen).with_loads([pull]), specimen)
    assert isinstance(found, StretchedModel)
    return found


def test_newton_steps_converge_quadratically(arm: StretchedModel, state: Any) -> None:  # type: ignore[type-arg]
    more = replace(INPUTS, pressures=1.1 * INPUTS.pressures)
    for _ in range(4):
        state = arm.advance(arm.linearise(state, more), np.zeros(7))
    assert arm.linearise(state, more).residual_norm < 1e-5
