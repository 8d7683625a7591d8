"""A toy arm with point masses: the force on it is what holds it, and mass times acceleration."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import savgol_filter

from softarm.estimator.arrays import Floats
from softarm.estimator.dynamics import MovingForces
from softarm.estimator.dynamics.reduced_arm import Reduction
from softarm.estimator.inverse import ArmEstimate, Estimator, LoadProcess, TrackerSettings
from softarm.estimator.model import Frames, Inputs, Load
from softarm.estimator.rotations import exp
from softarm.estimator.sensing import ActuationMap, Orientation, SensorSuite
from softarm.estimator.simulation.inertia import Masses
from tests.estimator.inverse.toy_arm import ToyArm

GRAVITY = np.array([0.0, 0.0, 9.81])
NOISE = 1e-3
SUITE = SensorSuite((Orientation("middle", 0, NOISE), Orientation("end", 1, NOISE)))
NEIGHBOURS = ((-1, 0), (0, 1))
MASSES = Masses(np.array([0.03, 0.05]), np.zeros(2))
STEP = 0.01
TIME = np.arange(0.0, 1.5, STEP)
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}
LOADS = tuple(Load(f"tip_{name}", "force", axis, section="tip") for name, axis in AXES.items())


def estimates(
    arm: ToyArm, holding: Floats, bent: float = 0.0, silent: slice = slice(0)
) -> list[tuple[Floats, ArmEstimate[Any]]]:
    """Return readings and estimates of an arm that stands at each instant as these forces hold it.

    Args:
        arm: The arm.
        holding: Forces, shape (instants, loads).
        bent: How far its middle is turned beside that [rad/N].
        silent: Instants at which the sensor there gives no reading.
    """
    rng = np.random.default_rng(1)
    settings = TrackerSettings(
        LoadProcess(np.ones(len(arm.loads)), 0.0),
        ActuationMap(np.ones(6), np.zeros(6), sigma=np.full(6, 10.0)),
        np.full(6, 65e3),
    )
    follower, found, state = Estimator(arm, SUITE, settings), [], arm.rest()
    for number, (time, loads) in enumerate(zip(TIME, holding, strict=False)):
        inputs = Inputs(np.zeros(6), loads, GRAVITY)
        state, _ = arm.solve(inputs, state)
        frames = arm.frames(state)
        turned = rng.normal(0.0, NOISE, (2, 3))
        turned[0, 1] += bent * loads[0]
        readings = SUITE.predict(Frames(frames.positions, frames.rotations @ exp(turned)))
        if number in range(*silent.indices(len(TIME))):
            readings[SUITE.reading_slices["middle"]] = np.nan
        found.append((readings, follower.update(float(time), readings, np.zeros(6), GRAVITY)))
    return found


def moving(arm: ToyArm) -> MovingForces:
    return MovingForces(arm.sections, NEIGHBOURS, MASSES, arm.loads, SUITE)


@pytest.fixture
def arm() -> ToyArm:
    return ToyArm(LOADS)


def swinging(arm: ToyArm) -> Floats:
    """Return the forces that would hold the arm where it passes while it swings freely."""
    (readings, at), *_ = estimates(arm, np.zeros((1, len(arm.loads))))
    small = Reduction.of(LOADS, arm.sections, NEIGHBOURS, MASSES).at(at, SUITE.sensor_noise(readings))
    assert small is not None
    holding = np.zeros((len(TIME), len(arm.loads)))
    lowest = np.sqrt(np.linalg.eigvals(np.linalg.solve(small.mass, small.stiffness)).min())
    holding[:, 0] = 0.05 * np.cos(lowest * TIME)
    return holding


def test_mass_times_acceleration_is_not_taken_for_a_force(arm: ToyArm) -> None:
    """What acts on the tip is the force that holds it there, and the masses times their accelerations."""
    holding = swinging(arm)
    found, followed = estimates(arm, holding), moving(arm)
    forces = np.array(
        [followed.update(t, seen, at)[0][0] for t, (seen, at) in zip(TIME.tolist(), found, strict=True)]
    )
    true = holding[:, 0].copy()
    for section, mass in enumerate(MASSES.sections):
        places = np.array([at.frames.positions[section, 0] for _, at in found])
        by_tip = np.array([at.motion[6 * section, 6] / at.motion[6, 6] for _, at in found])
        true += mass * by_tip * savgol_filter(places, 15, 3, deriv=2, delta=STEP)
    later = slice(60, -10)
    held = np.abs(holding[later, 0] - true[later])
    assert held.mean() > 0.02
    assert np.abs(forces[later] - true[later]).mean() < 0.3 * held.mean()


def test_masses_and_stiffness_are_those_of_the_tip(arm: ToyArm) -> None:
    (readings, at), *_ = estimates(arm, np.tile([0.05, 0.0], (len(TIME), 1)))
    alone = Masses(np.array([0.0, 0.05]), np.zeros(2))
    small = Reduction.of(arm.loads, arm.sections, NEIGHBOURS, alone).at(at, SUITE.sensor_noise(readings))
    assert small is not None
    np.testing.assert_allclose(small.mass, 0.05 * np.eye(2), atol=2e-3)
    less, more = (
        arm.frames(arm.solve(Inputs(np.zeros(6), at.inputs.loads + change, GRAVITY), at.state)[0])
        for change in ([-1e-4, 0.0], [1e-4, 0.0])
    )
    moved = more.positions[1, :2] - less.positions[1, :2]
    np.testing.assert_allclose(small.stiffness @ moved, [2e-4, 0.0], atol=4e-6)
    lowest = np.sqrt(np.linalg.eigvalsh(small.stiffness)[0] / 0.05)
    assert 0.95 * lowest / np.sqrt(2.0) < small.slowest < lowest


def test_a_sensor_that_falls_silent_while_the_arm_swings_is_not_taken_for_a_push(arm: ToyArm) -> None:
    """The arm swings in another shape than a force on the tip gives it, which then shows no longer."""
    silent = slice(70, 73)

    def forces(silent: slice) -> Floats:
        found, followed = estimates(arm, swinging(arm), 0.2, silent), moving(arm)
        return np.array(
            [followed.update(t, seen, at)[0][0] for t, (seen, at) in zip(TIME.tolist(), found, strict=True)]
        )

    assert np.abs(forces(silent) - forces(slice(0)))[60:].max() < 0.01


@pytest.mark.parametrize("why", ["pause", "moment", "unheard", "diverged"])
def test_an_estimate_stays_as_it_is_where_motion_cannot_be_told(arm: ToyArm, why: str) -> None:
    if why == "moment":
        arm = arm.with_loads((*LOADS, Load("tip_mz", "moment", (0.0, 0.0, 1.0), section="tip")))
    holding = np.zeros((40, len(arm.loads)))
    holding[:, :2] = swinging(ToyArm(LOADS))[:40]
    found, followed = estimates(arm, holding), moving(arm)
    for number, (readings, at) in enumerate(found):
        followed.update(STEP * number, readings, at)
    readings, at = found[-1]
    time = TIME[len(found)] + (1.0 if why == "pause" else 0.0)
    if why == "unheard":
        at = replace(at, rows=tuple(row for row in at.rows if row.name != "sensors"))
    elif why == "diverged":
        at = replace(at, status="diverged")
    forces, covariance = followed.update(float(time), readings, at)
    np.testing.assert_array_equal(forces, at.inputs.loads)
    np.testing.assert_array_equal(covariance, at.load_covariance)
