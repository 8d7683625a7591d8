from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.errors import InputError
from softarm.estimator.model import Frames, Inputs
from softarm.estimator.sequential_batch import SequentialBatchModel
from softarm.estimator.simulation import Drive, LinearisedArm, Segments, SimulatedArm, section_loads
from tests.estimator.inverse.toy_arm import LENGTH, STIFFNESS, ToyArm

SECTIONS = ("intermediate", "tip")


def toy() -> SimulatedArm:
    model = ToyArm(section_loads(SECTIONS))
    rest = Frames(np.array([[0, 0, LENGTH], [0, 0, 2 * LENGTH]], dtype=float), np.tile(np.eye(3), (2, 1, 1)))
    return SimulatedArm(SequentialBatchModel(model), Segments(("upper", "lower"), (-1, 0), (0, 1), rest))


def some_drive() -> Drive:
    pressures = np.array([[1e4, 0, 0, 0, 2e4, 0], [2e4, 0, 5e3, 0, 2e4, 0]], dtype=float)
    return Drive.of(np.array([0.0, 0.1]), pressures, np.array([0.0, 0.0, 9.81]), 2, 2)


def test_the_response_is_that_of_the_model():
    arm, drive = toy(), some_drive()
    response = arm.respond(drive)
    state, found = arm.model.model.solve(
        Inputs(drive.pressures[1], np.zeros(12), drive.gravity[1]), np.zeros(8)
    )
    assert found
    assert response.converged.all()
    assert np.allclose(response.frames.positions[1], arm.model.model.frames(state).positions, atol=1e-9)


def test_stiffness_is_that_of_the_segments():
    assert np.allclose(toy().stiffness().reshape(-1), STIFFNESS, rtol=1e-3)


def test_a_couple_bends_only_its_segment():
    arm, drive = toy(), some_drive()
    still = replace(drive, pressures=0.0 * drive.pressures, gravity=0.0 * drive.gravity)
    couples = np.zeros((2, 2, 4))
    couples[:, 1, 0] = 2e-3
    strains = arm.respond(replace(still, couples=couples)).strains
    assert np.allclose(strains[:, 1, 0], 2e-3 / STIFFNESS[4], rtol=1e-2)
    assert np.abs(strains[:, 0, :3]).max() < 1e-6


def test_a_turned_base_turns_the_frames_and_gravity():
    arm, drive = toy(), some_drive()
    turn = np.array([0.0, 0.4, 0.0])
    weightless = replace(drive, gravity=0.0 * drive.gravity)
    plain = arm.respond(weightless)
    turned = arm.respond(replace(weightless, base_rotation=np.tile(turn, (2, 1))))
    assert np.allclose(turned.strains, plain.strains, atol=1e-10)
    assert not np.allclose(turned.frames.positions, plain.frames.positions, atol=1e-2)
    heavy = arm.respond(replace(drive, base_rotation=np.tile(turn, (2, 1))))
    assert not np.allclose(heavy.strains, arm.respond(drive).strains, atol=1e-4)


@pytest.mark.parametrize("what", ["pressures", "wrenches", "couples", "gravity", "base_rotation"])
def test_the_linearised_arm_is_right_to_first_order(what: str):
    arm, drive = toy(), some_drive()
    baseline = arm.respond(drive)
    linear = LinearisedArm(arm.segments, drive, baseline)
    value = getattr(drive, what)
    unit = np.random.default_rng(1).normal(size=value.shape)
    unit *= {"pressures": 300.0, "wrenches": 2e-3, "couples": 3e-4, "gravity": 0.3, "base_rotation": 0.01}[
        what
    ]
    moved = replace(drive, **{what: value + unit})
    exact, guess = arm.respond(moved, baseline).strains, linear.respond(moved).strains
    assert np.abs(guess - exact).max() < 0.05 * np.abs(exact - baseline.strains).max() + 1e-9
    places = arm.respond(moved, baseline).frames.positions
    shift = np.abs(places - baseline.frames.positions).max()
    assert np.abs(linear.respond(moved).frames.positions - places).max() < 0.05 * shift


def test_a_model_with_other_loads_is_refused():
    arm = toy()
    with pytest.raises(InputError, match="section_loads"):
        SimulatedArm(SequentialBatchModel(arm.model.model.with_loads(())), arm.segments)
