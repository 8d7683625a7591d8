from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.errors import InputError
from softarm.fakes.plant.arm import FakeArm
from softarm.fakes.plant.parameters import GRAVITY, ArmParameters, Mount, sopra
from softarm.fakes.plant.rotations import product, rotation_matrix, vector_quaternion
from softarm.fakes.plant.state import Cord, Hand, PlantInputs
from tests.sim_fakes.plant.driving import MakeArm, hold, pressures

VENTED = PlantInputs(np.zeros(6))


def test_a_vented_arm_stays_at_rest(make_arm: MakeArm) -> None:
    arm = make_arm()
    before = arm.state
    after = hold(arm, VENTED, 1.0)
    assert arm.energy < 1e-9
    np.testing.assert_allclose(after.positions, before.positions, atol=1e-6)
    np.testing.assert_allclose(after.bends, 0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(after.specific_forces, axis=1), GRAVITY, rtol=1e-6)


def test_it_hangs_from_the_mount_stretched_by_its_weight(make_arm: MakeArm) -> None:
    state = make_arm().state
    np.testing.assert_allclose(state.positions[0], (0.0, 0.0, 0.6))
    hanging = 0.6 - state.positions[:, 2]
    assert 0.1405 < hanging[1] < 0.145
    assert 0.276 < hanging[2] < 0.284


def test_a_swing_dies_out_at_the_frequency_of_the_real_arm() -> None:
    arm = FakeArm(sopra())
    hold(arm, pressures(c0=30e3), 4.0)
    swing = np.array([hold(arm, VENTED, 0.01).bends[0, 0] for _ in range(300)])
    crossings = np.flatnonzero(np.diff(np.sign(swing - swing[-50:].mean())) != 0)
    frequency = 0.5 / np.diff(crossings[:8]).mean() / 0.01
    assert 1.6 < frequency < 3.0
    assert np.ptp(swing[200:]) < 0.3 * np.ptp(swing[:100])
    hold(arm, VENTED, 6.0)
    assert arm.energy < 1e-6


def test_the_static_gain_is_of_the_order_of_the_recorded_one() -> None:
    for chamber, segment in ((0, 0), (3, 1)):
        state = hold(FakeArm(sopra()), pressures(**{f"c{chamber}": 40e3}), 5.0)
        degrees_per_bar = np.degrees(np.hypot(*state.bends[segment])) / 0.4
        assert 65.0 < degrees_per_bar < 95.0


@pytest.mark.parametrize("segment", [0, 1])
def test_chambers_of_a_segment_act_alike_at_their_azimuths(make_arm: MakeArm, segment: int) -> None:
    bends = []
    for number in range(3):
        state = hold(make_arm(), pressures(**{f"c{3 * segment + number}": 25e3}), 1.0)
        angle = -2.0 * np.pi / 3.0 * number
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        bends.append(state.bends @ turn.T)
    np.testing.assert_allclose(bends[1], bends[0], atol=1e-6)
    np.testing.assert_allclose(bends[2], bends[0], atol=1e-6)
    assert bends[0][segment, 0] < -0.1
    np.testing.assert_allclose(bends[0][:, 1], 0.0, atol=1e-6)


def test_equal_pressures_only_lengthen(make_arm: MakeArm) -> None:
    arm = make_arm()
    rest = arm.state.positions
    state = hold(arm, PlantInputs(np.full(6, 30e3)), 2.0)
    np.testing.assert_allclose(state.bends, 0.0, atol=1e-6)
    assert 0.005 < rest[-1, 2] - state.positions[-1, 2] < 0.05


def test_a_turned_mount_turns_gravity(small: ArmParameters) -> None:
    sideways = product(np.array([0.0, 1.0, 0.0, 0.0]), vector_quaternion(np.array([0.0, np.pi / 2, 0.0])))
    mount = Mount(quaternion=(sideways[0], sideways[1], sideways[2], sideways[3]))
    arm = FakeArm(replace(small, mount=mount))
    axis = rotation_matrix(sideways)[:, 2]
    np.testing.assert_allclose(axis[2], 0.0, atol=1e-12)
    assert arm.state.positions[-1, 2] < 0.6 - 0.03
    assert np.hypot(*arm.state.bends[0]) > 0.2


def test_the_same_inputs_give_the_same_motion(make_arm: MakeArm) -> None:
    first, second = make_arm(), make_arm()
    for number in range(1, 51):
        hold(first, pressures(c0=20e3, c4=30e3), 0.008)
        if number % 5 == 0:
            hold(second, pressures(c0=20e3, c4=30e3), 0.04)
    np.testing.assert_array_equal(first.state.positions, second.state.positions)
    np.testing.assert_array_equal(first.state.bends, second.state.bends)


def test_steps_shorter_than_its_own_add_up(make_arm: MakeArm) -> None:
    often, once = make_arm(), make_arm()
    for number in range(1, 101):
        often.advance(number * 1e-3, pressures(c2=20e3))
    once.advance(0.1, pressures(c2=20e3))
    assert often.state.time == once.state.time == pytest.approx(0.1)
    np.testing.assert_array_equal(often.state.positions, once.state.positions)


def test_a_hand_draws_a_section_and_is_reported(make_arm: MakeArm) -> None:
    arm = make_arm()
    start = arm.state.positions[2]
    target = start + np.array([0.05, 0.0, 0.01])
    hand = Hand("tip", position=(target[0], target[1], target[2]), stiffness=300.0)
    state = hold(arm, PlantInputs(np.zeros(6), hand=hand), 3.0)
    assert np.linalg.norm(state.positions[2] - target) < 0.4 * np.linalg.norm(start - target)
    np.testing.assert_allclose(state.external_forces[2], 300.0 * (target - state.positions[2]), atol=1e-3)


def test_mistakes_are_told(make_arm: MakeArm) -> None:
    arm = make_arm()
    hold(arm, VENTED, 0.1)
    with pytest.raises(InputError, match="before"):
        arm.advance(0.05, VENTED)
    with pytest.raises(InputError, match="6 values"):
        hold(arm, PlantInputs(np.zeros(4)), 0.1)
    with pytest.raises(InputError, match="elbow"):
        hold(arm, PlantInputs(np.zeros(6), cord=Cord("elbow", (0.0, 0.0, 0.0), 0.1)), 0.1)


def test_the_inertial_readings_agree_with_the_motion(make_arm: MakeArm) -> None:
    """Rates and forces are those of the last step, whose speed at its end moves the arm."""
    arm = make_arm()
    inputs, step = pressures(c0=25e3, c4=15e3), arm.parameters.step
    states = [hold(arm, inputs, step) for _ in range(150)]
    for section in (1, 2):
        turns = np.array([state.quaternions[section] for state in states])
        rates = np.array([state.angular_velocities[section] for state in states])
        change = product(turns[:-1] * [1.0, -1.0, -1.0, -1.0], turns[1:])
        moved = 2.0 * change[:, 1:] * np.sign(change[:, :1])
        np.testing.assert_allclose(moved / step, rates[1:], atol=0.03)
        places = np.array([state.positions[section] for state in states])
        felt = [
            rotation_matrix(state.quaternions[section]) @ state.specific_forces[section] for state in states
        ]
        seen = np.diff(places, 2, axis=0) / step**2 + [0.0, 0.0, GRAVITY]
        error = np.array(felt)[2:] - seen
        assert np.sqrt(np.mean(error[20:] ** 2)) < 0.1 * np.std(seen[20:])
