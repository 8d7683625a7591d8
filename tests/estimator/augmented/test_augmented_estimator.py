"""With the right physics in the model no force is left; without it, there seems to be one."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.augmented import AugmentedEstimator, AugmentedModel, LoadDistribution
from softarm.estimator.augmented.estimator import registration_corrected, subtract_sensor_effect
from softarm.estimator.effects import EFFECTS, Spot, World
from softarm.estimator.effects.placed import PlacedEffect
from softarm.estimator.effects.simulate import recorded_rotation, simulate_with, standing_pressures
from softarm.estimator.errors import InputError
from softarm.estimator.inverse import Estimator, LoadProcess, TrackerSettings
from softarm.estimator.model import Inputs, Load
from softarm.estimator.rotations import exp, to_quaternions
from softarm.estimator.sensing import ActuationMap, Orientation, Registration, SensorSuite
from softarm.estimator.simulation import Drive
from softarm.estimator.simulation.compliance import bounded_inverse
from softarm.estimator.specimen.physics import Place
from tests.estimator.simulation.straight_arm import AZIMUTHS, MASSES, surface_of
from tests.estimator.simulation.test_simulation_arm import toy

SECTIONS = ("intermediate", "tip")
LOADS = tuple(
    Load(f"{section}_{axis}", "force", direction, section)
    for section in SECTIONS
    for axis, direction in (("x", (1.0, 0.0, 0.0)), ("y", (0.0, 1.0, 0.0)))
)
SUITE = SensorSuite(
    tuple(
        Orientation(f"orientation_{s}", k, 1e-3, np.zeros(3), Registration()) for k, s in enumerate(SECTIONS)
    )
)
NAMES = tuple(sensor.name for sensor in SUITE.measurements)
GRAVITY = np.array([0.0, 0.0, 9.81])
TURNED = np.array([9.81, 0.0, 0.0])
ACTUATION = ActuationMap(np.linspace(0.9, 1.1, 6), np.linspace(-300.0, 300.0, 6), 5.0)
SETTINGS = TrackerSettings(LoadProcess(np.full(4, 0.5), 0.0), ACTUATION, np.full(6, 65e3))
ARM = toy()
MODEL = ARM.model.model
WORLD = World(
    ("upper", "lower"),
    SECTIONS,
    NAMES,
    (0, 0, 0, 1, 1, 1),
    AZIMUTHS,
    np.full(6, 65e3),
    ARM.stiffness(),
    MASSES,
    np.zeros(2),
    ARM.segments.rest.positions,
    surface_of(ARM.segments),
)
CASES = [
    ("tip_payload", [0.02], {"section": "tip"}),
    ("segment_stiffness", [0.3], {"segment": "lower"}),
    ("chamber_gain", [0.15], {"chamber": 1}),
    ("distributed_mass", [0.4], {}),
    ("base_tilt", [0.06, -0.04, 0.5], {}),
    ("viscoelastic_creep", [0.2, 0.7, 0.0], {}),
    ("sensor_bias", [0.03, -0.02], {"sensor": "orientation_tip"}),
    ("line_lag", [0.4], {}),
]


def placed(name: str, theta: list[float], where: dict) -> PlacedEffect:
    return PlacedEffect(EFFECTS[name], Spot(WORLD, Place(**where)), np.array(theta))


def recorded(effect: PlacedEffect, samples: int = 22) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, measured pressures, and readings of the arm with the effect and without any force."""
    time = 0.1 * np.arange(samples)
    measured = np.zeros((samples, 6))
    measured[:, 1] = np.clip(time, 0.0, 1.5) * 12e3
    measured[:, 3] = np.clip(time, 0.0, 1.0) * 15e3
    drive = Drive.of(time, ACTUATION.to_chamber(measured), GRAVITY, 2, 2)
    done = simulate_with([effect], ARM, WORLD, drive, SUITE)
    assert done.settled
    return time, measured, np.concatenate([done.readings[name] for name in NAMES], axis=1)


def forces(
    estimator: Estimator | AugmentedEstimator, time, measured, readings, gravity: np.ndarray = GRAVITY
) -> np.ndarray:
    found = [
        estimator.update(float(t), y, p, gravity) for t, p, y in zip(time, measured, readings, strict=True)
    ]
    assert all(estimate.converged for estimate in found)
    return np.array([estimate.inputs.loads for estimate in found])


@pytest.mark.parametrize(("name", "theta", "where"), CASES, ids=[case[0] for case in CASES])
def test_physics_in_the_model_is_no_longer_taken_for_a_force(name: str, theta: list[float], where: dict):
    effect = placed(name, theta, where)
    data = recorded(effect)
    plain = AugmentedEstimator(MODEL, ARM.segments, LOADS, WORLD, (), SUITE, SETTINGS)
    better = AugmentedEstimator(MODEL, ARM.segments, LOADS, WORLD, (effect,), SUITE, SETTINGS)
    wrong, right = (np.sqrt((forces(one, *data) ** 2).mean()) for one in (plain, better))
    assert wrong > 2e-3
    assert right < 0.2 * wrong


@pytest.mark.parametrize(
    ("name", "theta"),
    [("base_tilt", [0.06, -0.04, 0.0]), ("base_compliance", [0.4, 0.01])],
    ids=["tilt", "yields"],
)
def test_a_laboratory_found_by_a_base_that_had_turned_is_turned_back(name: str, theta: list[float]):
    effect = placed(name, theta, {})
    found_at_rest = Registration(exp(np.array([np.pi, 0.0, 0.0])))
    rested = SensorSuite(tuple(replace(m, registration=found_at_rest) for m in SUITE.measurements))
    time, measured, _ = recorded(effect)
    drive = Drive.of(time, ACTUATION.to_chamber(measured), TURNED, 2, 2)
    done = simulate_with([effect], ARM, WORLD, drive, rested)
    data = time, measured, np.concatenate([done.readings[name] for name in NAMES], axis=1), TURNED
    rotation = recorded_rotation(done.drive.base_rotation, [effect])
    suite = rested.moved(np.concatenate([np.zeros(3), -rotation]))
    again = registration_corrected(suite, ARM, WORLD, [effect], drive)
    estimators = [
        AugmentedEstimator(MODEL, ARM.segments, LOADS, WORLD, (effect,), own, SETTINGS)
        for own in (suite, again)
    ]
    wrong, right = (np.sqrt((forces(one, *data) ** 2).mean()) for one in estimators)
    assert right < 0.2 * wrong


def test_without_effects_it_is_the_plain_estimator():
    time, measured, readings = recorded(placed("tip_payload", [0.02], {"section": "tip"}), 5)
    wrapped = forces(
        AugmentedEstimator(MODEL, ARM.segments, LOADS, WORLD, (), SUITE, SETTINGS),
        time,
        measured,
        readings,
    )
    arm = type(MODEL)(LOADS)
    plain = forces(Estimator(arm, SUITE, SETTINGS), time, measured, readings)
    assert np.allclose(wrapped, plain, atol=1e-6)


def test_a_turned_base_turns_everything_with_it():
    turn = exp(np.array([0.1, -0.2, 0.05]))
    shaped = AugmentedModel(MODEL, LoadDistribution(LOADS, SECTIONS), np.zeros(12), turn)
    inputs = Inputs(
        np.full(6, 5e3) * np.array([1, 0, 0, 0, 1, 0]), np.array([0.05, 0.0, -0.1, 0.02]), GRAVITY
    )
    state, converged = shaped.solve(inputs, shaped.rest())
    assert converged
    step = shaped.linearise(state, inputs)
    change = np.zeros(10)
    change[[1, 7]] = 20.0, 1e-3
    moved_inputs = Inputs(inputs.pressures + change[:6], inputs.loads + change[6:], GRAVITY)
    moved = shaped.linearise(shaped.solve(moved_inputs, state)[0], moved_inputs).frames
    _, columns = step.response(np.eye(12))
    twists = (columns @ change).reshape(2, 6)
    assert np.allclose(moved.positions - step.frames.positions, twists[:, :3], atol=2e-7)
    level = exp(np.zeros(3))
    plain = AugmentedModel(MODEL, LoadDistribution(LOADS, SECTIONS), np.zeros(12), level)
    free = Inputs(np.zeros(6), np.zeros(4), GRAVITY)
    tilted = Inputs(np.zeros(6), np.zeros(4), turn @ GRAVITY)
    one = shaped.linearise(shaped.solve(tilted, shaped.rest())[0], tilted).frames
    other = plain.linearise(plain.solve(free, plain.rest())[0], free).frames
    assert np.allclose(one.positions, other.positions @ turn.T, atol=1e-9)


def test_a_sensors_effect_is_undone_exactly():
    before, twist, reading = (
        exp(np.array(v)) for v in ([0.3, 0.1, 0.0], [0.0, 0.02, 0.05], [0.28, 0.12, 0.01])
    )
    plain, changed = to_quaternions(before), to_quaternions(before @ twist)
    clean = subtract_sensor_effect(to_quaternions(reading @ twist), plain, changed)
    assert np.allclose(np.abs(clean @ to_quaternions(reading)), 1.0, atol=1e-12)
    assert np.allclose(
        subtract_sensor_effect(np.array([0.5, 0.1]), np.array([0.4, 0.2]), np.array([0.44, 0.2])), [0.46, 0.1]
    )


def test_stiffness_is_the_inverse_of_compliance_within_bounds():
    rest = np.array([[0.04, 0.04, 0.03, 60.0]])
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(4, 4)))[0]
    scale = np.sqrt(rest[0])
    wanted = scale[:, None] * (turn @ np.diag([0.5, 1.0, 2.0, 3.0]) @ turn.T) * scale
    assert np.allclose(bounded_inverse(np.linalg.inv(wanted)[None], rest)[0], wanted)
    lost = bounded_inverse(-np.linalg.inv(wanted)[None], rest)[0] / np.outer(scale, scale)
    assert np.allclose(np.linalg.eigvalsh(lost), 8.0)


def test_loads_must_act_on_sections():
    with pytest.raises(InputError, match="acts on no section"):
        LoadDistribution((Load("push", "force", (1.0, 0.0, 0.0), height=0.1),), SECTIONS)


@pytest.mark.parametrize(
    ("name", "theta", "where"),
    [("chamber_gain", [0.15], {"chamber": 1}), ("pressure_bias", [800.0], {"chamber": 2})],
)
def test_pressures_that_are_to_act_are_taken_back_through_the_physics(name, theta, where) -> None:
    effect = placed(name, theta, where)
    estimator = AugmentedEstimator(MODEL, ARM.segments, LOADS, WORLD, (effect,), SUITE, SETTINGS)
    wanted = np.linspace(5e3, 20e3, 6)
    given = estimator.pressures_before_effects(wanted)
    assert np.abs(given - wanted).max() > 100.0
    drive = Drive.of(np.zeros(1), given[None], GRAVITY, 2, 2)
    np.testing.assert_allclose(standing_pressures((effect,), WORLD, drive)[0], wanted, atol=1.0)


def test_an_instant_without_any_reading_is_predicted_from_the_pressures() -> None:
    effect = placed("chamber_gain", [0.15], {"chamber": 1})
    estimator = AugmentedEstimator(MODEL, ARM.segments, LOADS, WORLD, (effect,), SUITE, SETTINGS)
    estimate = estimator.update(0.0, SUITE.stack({}), np.full(6, 5e3), GRAVITY)
    assert estimate.converged
    np.testing.assert_allclose(estimate.inputs.loads, 0.0, atol=1e-6)
