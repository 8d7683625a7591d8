"""Every sensor: it predicts what it would read, and its Jacobians are those of its innovation."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.errors import InputError
from softarm.estimator.model import Frames
from softarm.estimator.rotations import exp
from softarm.estimator.sensing import (
    ActuationMap,
    Bend,
    MarkerPosition,
    MeasuredPose,
    Measurement,
    Orientation,
    Registration,
    SensorSuite,
    register,
)
from tests.estimator.derivatives import derivative_error

RANDOM = np.random.default_rng(5)
SAMPLES = 7
REGISTRATION = Registration(exp(np.array([0.3, -1.2, 0.5])), np.array([0.2, -0.1, 1.0]))


def frames(leading: tuple[int, ...] = ()) -> Frames:
    positions = RANDOM.normal(size=(*leading, 2, 3)) * 0.1
    rotations = exp(RANDOM.normal(size=(*leading, 2, 3)) * 0.6)
    return Frames(positions, rotations)


def moved(at: Frames, twists: np.ndarray) -> Frames:
    parts = twists.reshape(2, 6)
    return Frames(at.positions + parts[:, :3], exp(parts[:, 3:]) @ at.rotations)


def misaligned(sensor: Measurement) -> Measurement:
    return sensor.with_parameters(sensor.parameters + RANDOM.normal(size=len(sensor.parameter_names)) * 0.2)


SENSORS = [
    misaligned(Orientation("orientation", 1, 0.01, registration=REGISTRATION)),
    misaligned(MeasuredPose("pose", 1, 1e-3, 0.01, registration=REGISTRATION)),
    misaligned(MarkerPosition("marker", 0, 1e-3, np.array([0.01, 0.02, -0.03]), registration=REGISTRATION)),
    misaligned(Bend("bend_upper", 0, 0.01)),
    misaligned(Bend("bend_lower", 1, 0.01, reference=0, mirrored=True)),
]
EACH = pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor.name)


@EACH
def test_own_prediction_leaves_no_innovation(sensor: Measurement) -> None:
    at = frames()
    np.testing.assert_allclose(sensor.sensitivity(at, sensor.predict(at)).innovation, 0.0, atol=1e-12)


@EACH
def test_rows_are_the_derivative_by_the_section_twists(sensor: Measurement) -> None:
    at, reading = frames(), sensor.predict(frames())

    def innovation(twists: np.ndarray) -> np.ndarray:
        return -sensor.sensitivity(moved(at, twists), reading).innovation

    rows = sensor.sensitivity(at, reading).twists
    assert derivative_error(innovation, rows, np.zeros(12), 1e-3) < 1e-7


@EACH
def test_rows_are_the_derivative_by_the_alignment(sensor: Measurement) -> None:
    at, reading = frames(), sensor.predict(frames())

    def innovation(parameters: np.ndarray) -> np.ndarray:
        return -sensor.with_parameters(parameters).sensitivity(at, reading).innovation

    rows = sensor.parameter_rows(at, reading)
    assert derivative_error(innovation, rows, sensor.parameters, 1e-3) < 1e-7


@EACH
def test_many_samples_at_once_give_what_each_gives_alone(sensor: Measurement) -> None:
    at, reading = frames((SAMPLES,)), sensor.predict(frames((SAMPLES,)))
    together = sensor.sensitivity(at, reading)
    parameters = sensor.parameter_rows(at, reading)
    noise = sensor.covariance(reading)
    for k in range(SAMPLES):
        one = Frames(at.positions[k], at.rotations[k])
        alone = sensor.sensitivity(one, reading[k])
        np.testing.assert_allclose(together.innovation[k], alone.innovation, atol=1e-14)
        np.testing.assert_allclose(together.twists[k], alone.twists, atol=1e-14)
        np.testing.assert_allclose(parameters[k], sensor.parameter_rows(one, reading[k]), atol=1e-14)
        np.testing.assert_allclose(noise[k], sensor.covariance(reading[k]))


def test_bend_is_exact_and_differentiable_at_the_straight_pose() -> None:
    straight = Frames(np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
    bend = Bend("bend", 1, 0.01)
    rows = bend.sensitivity(straight, np.zeros(2)).twists
    for angle in (1e-5, 1e-4, 2e-3, 0.5, 3.0):
        turned = moved(straight, np.concatenate([np.zeros(9), [0.0, angle, 0.0]]))
        np.testing.assert_allclose(bend.predict(turned), [angle, 0.0], atol=1e-12)
    np.testing.assert_allclose(rows[:, 9:], [[0, 1, 0], [-1, 0, 0]], atol=1e-15)


def test_registration_recovers_the_laboratory_within_its_covariance() -> None:
    markers = np.array([[0.05, 0, 0], [0, 0.05, 0.01], [-0.04, -0.03, 0.0], [0, 0, 0.03]])
    sigma = 1e-4
    deviations = []
    for _ in range(300):
        measured = REGISTRATION.to_laboratory(markers) + sigma * RANDOM.normal(size=markers.shape)
        found = register(markers, measured, sigma)
        turn = found.rotation @ REGISTRATION.rotation.T
        shift = found.translation - turn @ REGISTRATION.translation
        deviations.append(np.concatenate([shift, [turn[2, 1], turn[0, 2], turn[1, 0]]]))
    information = np.linalg.inv(found.covariance)
    squares = np.einsum("ni,ij,nj->n", deviations, information, deviations)
    assert squares.mean() == pytest.approx(6.0, rel=0.15)


def test_registration_refuses_markers_on_a_line() -> None:
    line = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    with pytest.raises(InputError, match="one line"):
        register(line, line, 1e-3)


def test_registration_by_two_markers_is_refused_and_never_advised_to_do_without() -> None:
    seen = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [np.nan] * 3])
    with pytest.raises(
        InputError, match=r"2 of 3 are seen, .*; record three of them, named as in the specimen"
    ):
        register(np.eye(3), seen, 1e-3)


def test_suite_stacks_any_subset_and_leaves_absent_sensors_out() -> None:
    suite = SensorSuite(tuple(SENSORS))
    at = frames()
    everything = suite.predict(at)
    some = suite.stack({"pose": SENSORS[1].predict(at), "bend_lower": SENSORS[4].predict(at)})
    observation = suite.observe(at, some)
    expected = [*range(3, 9), *range(14, 16)]
    assert observation.rows.tolist() == expected
    whole = suite.observe(at, everything)
    assert len(whole.rows) == suite.size
    np.testing.assert_allclose(observation.twists, whole.twists[expected])
    np.testing.assert_allclose(observation.covariance, whole.covariance[np.ix_(expected, expected)])
    assert suite.observe(at, np.full(len(everything), np.nan)).innovation.shape == (0,)
    half = everything.copy()
    half[7:11] = np.nan  # the pose's orientation alone is lost
    assert 3 in suite.observe(at, half).rows
    assert 6 not in suite.observe(at, half).rows


def test_suite_cuts_its_readings_and_names_the_unit_of_each_row() -> None:
    suite = SensorSuite(tuple(SENSORS))
    at = frames()
    readings = suite.predict(at)
    for sensor in SENSORS:
        own = readings[..., suite.reading_slices[sensor.name]]
        np.testing.assert_allclose(own, sensor.predict(at))
        assert len(suite.units[suite.slices[sensor.name]]) == sensor.size
    assert suite.reading_size == readings.shape[-1]
    lengths = [sensor.units for sensor in SENSORS if isinstance(sensor, MarkerPosition)]
    assert lengths == [("m", "m", "m")] * len(lengths)
    # Rows in metres move with the sections' places; those in radians do not.
    twists = suite.sensitivity(at, readings).twists
    moved = np.abs(twists.reshape(-1, *twists.shape[-2:])[:, :, [0, 1, 2, 6, 7, 8]]).max(axis=(0, 2)) > 1e-9
    assert [unit == "m" for unit in suite.units] == moved.tolist()


def test_suite_alignment_is_the_sensors_alignment() -> None:
    suite = SensorSuite(tuple(SENSORS))
    at, readings = frames(), suite.predict(frames())
    assert len(suite.parameter_names) == len(suite.parameters)
    error = derivative_error(
        lambda values: -suite.with_parameters(values).sensitivity(at, readings).innovation,
        suite.parameter_rows(at, readings),
        suite.parameters,
        1e-3,
    )
    assert error < 1e-7


def test_suite_names_a_wrong_reading() -> None:
    suite = SensorSuite(tuple(SENSORS))
    with pytest.raises(InputError, match="no sensor 'tip'"):
        suite.stack({"tip": np.zeros(3)})
    with pytest.raises(InputError, match="3 numbers instead of 4"):
        suite.stack({"orientation": np.zeros(3)})
    with pytest.raises(InputError, match="named twice"):
        SensorSuite((SENSORS[0], SENSORS[0]))


def test_error_of_the_registration_is_common_to_all_that_use_it() -> None:
    covariance = np.diag([1e-3, 2e-3, 3e-3, 0.02, 0.01, 0.03]) ** 2
    uncertain = replace(REGISTRATION, covariance=covariance)
    sensors = tuple(replace(sensor, registration=uncertain) for sensor in SENSORS[:3])
    suite, at = SensorSuite((*sensors, SENSORS[3])), frames()
    readings = suite.predict(at)
    noise = suite.covariance(at, readings, suite.sensitivity(at, readings).twists)
    exact = SensorSuite(tuple(SENSORS[:4]))
    alone = exact.covariance(at, readings, exact.sensitivity(at, readings).twists)

    def shifted(twist: np.ndarray) -> np.ndarray:
        turn = exp(twist[3:])
        other = Registration(turn @ REGISTRATION.rotation, turn @ REGISTRATION.translation + twist[:3])
        return (
            SensorSuite((*(replace(sensor, registration=other) for sensor in SENSORS[:3]), SENSORS[3]))
            .sensitivity(at, readings)
            .innovation
        )

    rows = np.stack([(shifted(1e-6 * e) - shifted(-1e-6 * e)) / 2e-6 for e in np.eye(6)], axis=1)
    np.testing.assert_allclose(noise - alone, rows @ covariance @ rows.T, atol=1e-11)


def test_a_pressure_map_runs_both_ways() -> None:
    crosstalk = np.array([[0.0, 0.03], [-0.02, 0.0]])
    actuation = ActuationMap(
        np.array([0.9, 1.2]),
        np.array([300.0, -100.0]),
        curve=np.array([6e-6, -3e-6]),
        quadratic_gain=np.array([-2e-11, 3e-11]),
        crosstalk=crosstalk,
    )
    measured = np.array([[0.0, 1e4], [3e4, 6e4]])
    pressure = actuation.to_chamber(measured)
    np.testing.assert_allclose(actuation.to_measured(pressure), measured, rtol=1e-9, atol=1e-6)
    others = replace(actuation, crosstalk=0.0).to_chamber(measured)
    np.testing.assert_allclose(pressure - others, measured @ crosstalk.T)
    np.testing.assert_allclose(actuation.chamber_sigma, [180.0, 240.0])


def test_a_lost_pressure_leaves_the_other_chambers_known() -> None:
    actuation = ActuationMap(np.ones(2), np.zeros(2), crosstalk=np.array([[0.0, 0.1], [0.1, 0.0]]))
    acting = actuation.to_chamber(np.array([np.nan, 2e4]))
    assert np.isnan(acting[0])
    assert acting[1] == 2e4


def test_a_moved_registration_moves_what_it_maps_to() -> None:
    rng = np.random.default_rng(3)
    twist, points = rng.normal(0.0, 0.3, 6), rng.normal(size=(5, 3))
    one = Registration(exp(rng.normal(size=3)), rng.normal(size=3))
    wanted = one.to_base(points) @ exp(twist[3:]).T + twist[:3]
    np.testing.assert_allclose(one.moved(twist).to_base(points), wanted, atol=1e-12)
    np.testing.assert_allclose(one.moved(twist).to_laboratory(wanted), points, atol=1e-12)


@pytest.mark.parametrize("lost", [(), (0,), (0, 1)])
def test_orientations_at_one_instant_are_seen_as_among_other_sensors(lost: tuple[int, ...]) -> None:
    """A suite of orientations alone has a kernel of its own."""
    alone = [replace(SENSORS[0], name=f"orientation_{k}", section=k, sigma=0.01 + k) for k in (1, 0)]
    at, beside = frames(), SENSORS[3]
    readings = SensorSuite(tuple(alone)).predict(frames())
    for k in lost:
        readings[4 * k : 4 * k + 4] = np.nan
    seen = SensorSuite(tuple(alone)).observe(at, readings)
    among = SensorSuite((*alone, beside)).observe(at, np.concatenate([readings, [np.nan, np.nan]]))
    np.testing.assert_array_equal(seen.rows, among.rows)
    np.testing.assert_allclose(seen.innovation, among.innovation, atol=1e-15)
    np.testing.assert_allclose(seen.twists, among.twists, atol=1e-15)
    np.testing.assert_array_equal(seen.covariance, among.covariance)
