"""Reused and background factors change the path of an iteration, not where it ends."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from softarm.estimator.fem import FiniteElementModel
from softarm.estimator.fem.tracking import BackgroundFactorisation, TrackingModel, TrackingState
from softarm.estimator.fem.tracking.model import UNBALANCED
from softarm.estimator.model import Inputs

ArmOf = Callable[..., FiniteElementModel]
GRAVITY = np.array([0.0, 0.0, 9.81])


def _inputs(time: float) -> Inputs:
    pressure = 4e3 * (1.0 - np.cos(time))
    return Inputs(np.array([pressure]), np.array([0.05 * np.sin(time), 0.0, 0.03 * time]), GRAVITY)


def _follow(model: TrackingModel, state: TrackingState, target: Inputs) -> tuple[TrackingState, int]:
    """Iterate to the equilibrium under the target's inputs; count the linearisations."""
    change = np.concatenate([target.pressures - state.inputs.pressures, target.loads - state.inputs.loads])
    for count in range(1, 40):
        step = model.linearise(state, Inputs(state.inputs.pressures, state.inputs.loads, GRAVITY))
        if count > 1 and step.residual_norm < 1e-8:
            return state, count
        state = model.advance(step, change)
        change = np.zeros_like(change)
    raise AssertionError("it did not converge")


def test_reused_factors_reach_the_same_equilibria(arm_of: ArmOf) -> None:
    arm = arm_of("hex8")
    tracking = TrackingModel(arm)
    state, found = tracking.solve(_inputs(0.0), tracking.rest())
    assert found
    factors = set()
    for time in np.linspace(0.05, 1.0, 8):
        state, _ = _follow(tracking, state, _inputs(time))
        factors.add(id(state.tangent))
        exact = arm.equilibrium(_inputs(time)).value
        assert np.abs(exact.displacement - state.displacement).max() < 1e-8
    assert len(factors) < 8


def test_background_factors_are_taken_over(arm_of: ArmOf) -> None:
    arm = arm_of("hex8")
    with BackgroundFactorisation(arm) as background:
        tracking = TrackingModel(arm, background, slowing=0.0)
        state, _ = tracking.solve(_inputs(0.0), tracking.rest())
        counts = []
        for time in np.linspace(0.05, 1.0, 6):
            state, count = _follow(tracking, state, _inputs(time))
            background.wait()
            counts.append(count)
            assert np.abs(arm.equilibrium(_inputs(time)).value.displacement - state.displacement).max() < 1e-8
        assert state.tangent is not None
        assert max(counts) <= 6


def test_a_nearer_factor_is_taken_over_only_where_the_arm_has_just_moved(arm_of: ArmOf) -> None:
    arm = arm_of("hex8")
    with BackgroundFactorisation(arm) as background:
        tracking = TrackingModel(arm, background)
        state, _ = tracking.solve(_inputs(0.0), tracking.rest())
        state, _ = _follow(tracking, state, _inputs(0.3))
        background.wait()
        background.ask((state.displacement, state.inputs))
        background.wait()
        held, nearer = state.tangent, background.newest
        assert held is not nearer
        correcting, arrived = replace(state, forces=1e3), replace(state, forces=np.inf)
        assert tracking.linearise(correcting, state.inputs).tangent is held
        assert tracking.linearise(arrived, state.inputs).tangent is nearer


def test_an_old_factor_is_renewed_once_steps_with_it_have_cost_as_much_as_a_new_one(arm_of: ArmOf) -> None:
    tracking = TrackingModel(arm_of("hex8"))
    state, _ = tracking.solve(_inputs(0.0), tracking.rest())
    state, _ = _follow(tracking, state, _inputs(0.05))
    state = replace(state, forces=np.inf)  # inputs change in every step: no contraction is expected of it
    held, far = state.tangent, _inputs(2.0)
    assert tracking.linearise(state, far).residual_norm > tracking.slowing
    for unbalanced in range(UNBALANCED):
        assert tracking.linearise(replace(state, unbalanced=unbalanced), far).tangent is held
    assert tracking.linearise(replace(state, unbalanced=UNBALANCED), far).tangent is not held
    balanced = replace(state, unbalanced=UNBALANCED)
    assert tracking.linearise(balanced, state.inputs).tangent is held


def test_steps_out_of_balance_are_counted_and_a_balanced_one_ends_the_count(arm_of: ArmOf) -> None:
    tracking = TrackingModel(arm_of("hex8"))
    state, _ = tracking.solve(_inputs(0.0), tracking.rest())
    state, _ = _follow(tracking, state, _inputs(0.05))
    unchanged = np.zeros(4)
    off = tracking.linearise(replace(state, forces=np.inf, unbalanced=1), _inputs(2.0))
    assert tracking.advance(off, unchanged).unbalanced == 2
    balanced = tracking.linearise(replace(state, unbalanced=2), state.inputs)
    assert tracking.advance(balanced, unchanged).unbalanced == 0


def test_a_refreshed_state_is_linearised_with_a_factor_of_its_own(arm_of: ArmOf) -> None:
    tracking = TrackingModel(arm_of("hex8"))
    state, _ = tracking.solve(_inputs(0.0), tracking.rest())
    state, _ = _follow(tracking, state, _inputs(0.3))
    fresh = tracking.linearise(tracking.refreshed(state), state.inputs).tangent
    assert fresh is not None
    np.testing.assert_array_equal(fresh.displacement, state.displacement)
    assert tracking.linearise(state, state.inputs).tangent is state.tangent


def test_response_with_a_fresh_factor_is_that_of_the_model(arm_of: ArmOf) -> None:
    arm = arm_of("hex20")
    tracking = TrackingModel(arm)
    state, _ = tracking.solve(_inputs(1.0), tracking.rest())
    claimed = tracking.linearise(state, state.inputs).response(np.eye(6))
    exact = arm.linearise(arm.equilibrium(_inputs(1.0)).value, state.inputs).response(np.eye(6))
    assert np.abs(claimed[1] - exact[1]).max() < 1e-6 * np.abs(exact[1]).max()
