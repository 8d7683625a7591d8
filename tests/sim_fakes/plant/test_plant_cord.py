import numpy as np
import pytest

from softarm.fakes.plant.loads import TautLine
from softarm.fakes.plant.parameters import GRAVITY
from softarm.fakes.plant.state import Cord, PlantInputs
from tests.sim_fakes.plant.driving import MakeArm, hold

KNOT = np.array([0.0, 0.0, 0.1])


@pytest.mark.parametrize("span", np.linspace(0.05, 0.15, 11))
def test_a_line_never_pushes(span: float) -> None:
    line = TautLine(0.1, 1000.0, 5.0)
    for speed in (-1.0, 0.0, 1.0):
        force, tension = line.pull(KNOT, np.array([speed, 0.0, 0.0]), KNOT + np.array([span, 0.0, 0.0]))
        assert tension >= 0.0
        assert force[0] == tension
        if span <= 0.1:
            assert tension == 0.0


def test_the_cord_is_slack_until_its_stage_draws_it_taut(make_arm: MakeArm) -> None:
    arm = make_arm()
    tip = arm.state.positions[2]
    forces = []
    for travel in np.linspace(-0.02, 0.02, 9):
        hook = tip + np.array([0.2 + travel, 0.0, 0.02])
        cord = Cord("tip", (hook[0], hook[1], hook[2]), 0.2)
        hold(arm, PlantInputs(np.zeros(6), cord=cord), 0.2)
        state = hold(arm, PlantInputs(np.zeros(6), cord=cord), 0.8)
        forces.append(state.cord_force)
        away = hook - state.positions[2]
        expected = max(0.0, arm.parameters.cord_stiffness * (np.linalg.norm(away) - 0.2))
        assert state.cord_force == pytest.approx(expected, abs=5e-3)
    assert forces[:3] == [0.0, 0.0, 0.0]
    assert forces[-1] > 0.05
    assert np.all(np.diff(forces) >= 0.0)


def test_the_gauge_balances_the_moments_of_a_resting_arm(make_arm: MakeArm) -> None:
    """At every joint the rubber's torque holds the weight below it and the pull read by the gauge."""
    arm = make_arm()
    hook = arm.state.positions[2] + np.array([0.25, 0.1, 0.05])
    cord = Cord("tip", (hook[0], hook[1], hook[2]), 0.24)
    inputs = PlantInputs(np.array([0.0, 0.0, 20e3, 0.0, 15e3, 0.0]), cord=cord)
    state = hold(arm, inputs, 15.0)
    assert state.cord_force > 0.1
    away = hook - state.positions[2]
    pull = state.cord_force * away / np.linalg.norm(away)
    np.testing.assert_allclose(state.external_forces[2], pull, atol=1e-9)
    data, chain = arm._data, arm._chain
    down = arm._into_base @ np.array([0.0, 0.0, -GRAVITY])
    weights = chain.model.body_mass[:, None] * down
    knot = data.site_xpos[chain.sections[2]]
    for joint in range(len(chain.joints)):
        anchor, below = data.xpos[chain.bodies[joint]], chain.bodies[joint:]
        moment = np.cross(data.xipos[below] - anchor, weights[below]).sum(axis=0)
        moment += np.cross(knot - anchor, arm._into_base @ pull)
        turn = data.xmat[chain.bodies[joint]].reshape(3, 3)
        rubber = turn @ data.qfrc_applied[chain.balls[joint]]
        np.testing.assert_allclose(rubber, -moment, atol=2e-4 * np.abs(moment).max() + 1e-6)


def test_the_gauge_reads_no_less_on_the_way_out_than_on_the_way_back(make_arm: MakeArm) -> None:
    """An arm that is drawn out slowly gives back no more work than was done on it."""
    arm = make_arm()
    tip, forces = arm.state.positions[2].copy(), []
    there = np.linspace(0.0, 0.02, 401)
    for travel in [*there, *there[::-1]]:
        hook = tip + np.array([0.2 + travel, 0.0, 0.0])
        cord = Cord("tip", (hook[0], hook[1], hook[2]), 0.2)
        forces.append(hold(arm, PlantInputs(np.zeros(6), cord=cord), 0.01).cord_force)
    out, back = np.array(forces[:401]), np.array(forces[401:])[::-1]
    assert np.trapezoid(out, there) > np.trapezoid(back, there)
