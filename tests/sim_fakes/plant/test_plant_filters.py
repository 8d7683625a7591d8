import numpy as np
import pytest

from softarm.fakes.plant.effects import INSTRUMENT_EFFECTS, Concealed, Filter, filters
from softarm.fakes.plant.instruments import bends_of
from softarm.fakes.plant.rotations import product, quaternion_vector, vector_quaternion

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
SIGNALS = {
    "valve": np.linspace(0.0, 60e3, 6),
    "pressure": np.linspace(0.0, 60e3, 6),
    "pose": np.array([0.1, -0.05, 0.3, *vector_quaternion(np.array([0.1, 0.4, -0.2]))]),
    "bend": np.array([0.3, -0.2]),
    "gauge": np.array([0.7]),
}
CASES = [(name, signal) for name, known in INSTRUMENT_EFFECTS.items() for signal in known.signals]


def one(name: str, signal: str, sensor: str | None = None, **numbers: float) -> Filter:
    (made,) = filters((Concealed(name, {}, numbers),), signal, sensor)
    return made


@pytest.mark.parametrize(("name", "signal"), CASES)
def test_a_filter_without_strength_passes_everything(name: str, signal: str) -> None:
    chosen = one(name, signal, strength=0.0)
    for number in range(5):
        value = SIGNALS[signal] * (1.0 + (signal != "pose") * 0.1 * number)
        np.testing.assert_allclose(chosen.update(0.01 * number, value), value, atol=1e-12)


def test_a_place_chooses_the_sensor_and_the_chamber() -> None:
    scaled = (Concealed("sensor_scale", {"sensor": "bend_tip"}, {"change": 0.1}),)
    assert filters(scaled, "bend", "bend_intermediate") == ()
    (tip,) = filters(scaled, "bend", "bend_tip")
    np.testing.assert_allclose(tip.update(0.0, np.array([0.5, -0.1])), [0.55, -0.11])
    (valve,) = filters((Concealed("valve_deadband", {"chamber": 2}, {"width": 2e3}),), "valve")
    given = valve.update(0.0, np.full(6, 10e3))
    np.testing.assert_allclose(given, [10e3, 10e3, 8e3, 10e3, 10e3, 10e3])


def test_a_biased_valve_gives_more_than_it_says() -> None:
    outlet = one("pressure_bias", "valve", bias=2e3).update(0.0, np.array([0.0, 20e3]))
    np.testing.assert_allclose(outlet, [0.0, 22e3])
    np.testing.assert_allclose(one("pressure_bias", "pressure", bias=2e3).update(0.0, outlet), [0.0, 20e3])


def test_a_saturated_valve_is_cut() -> None:
    given = one("pressure_saturation", "valve", loss=25e3).update(0.0, np.array([30e3, 50e3]))
    np.testing.assert_allclose(given, [30e3, 40e3])


def test_latency_shifts_a_ramp() -> None:
    late = one("sensor_latency", "gauge", delay=0.075)
    times = np.arange(0.0, 1.0, 0.01)
    seen = np.array([late.update(t, np.array([2.0 * t]))[0] for t in times])
    np.testing.assert_allclose(seen[10:], 2.0 * (times[10:] - 0.075), atol=1e-9)
    np.testing.assert_allclose(seen[:7], 0.0)


def test_a_stuck_sensor_repeats_and_recovers() -> None:
    stuck = one("sensor_stuck", "gauge", start=0.2, length=0.3)
    seen = [stuck.update(5.0 + t, np.array([t]))[0] for t in np.arange(0.0, 1.0, 0.1)]
    np.testing.assert_allclose(seen, [0.0, 0.1, 0.2, 0.2, 0.2, 0.5, 0.6, 0.7, 0.8, 0.9])


@pytest.mark.parametrize("name", ["sensor_scale", "sensor_bias"])
def test_a_pose_and_its_bend_are_wrong_alike(name: str) -> None:
    """A faulty pose of the tip gives the bend that the same fault gives of the bend, over an upright base."""
    turn = vector_quaternion(np.array([0.25, 0.15, 0.0]))
    rest = np.array([0.0, 0.0, 0.3, *UPRIGHT])
    first, second = one(name, "pose"), one(name, "bend")
    first.update(0.0, rest)
    wrong = first.update(0.0, np.array([0.0, 0.0, 0.3, *turn]))
    bend = bends_of(np.array([[UPRIGHT, turn]]))[0, 0]
    expected = second.update(0.0, bend)
    np.testing.assert_allclose(bends_of(np.array([[UPRIGHT, wrong[3:]]]))[0, 0], expected, atol=3e-3)
    assert np.abs(expected - bend).max() > 5e-3


def test_a_misaligned_body_turns_the_bend_of_the_next() -> None:
    straight = np.array([0.0, 0.0, 0.3, *UPRIGHT])
    turn = vector_quaternion(np.array([0.25, 0.15, 0.0]))
    upper = one("frame_misalignment", "pose", yaw=0.2).update(0.0, straight)[3:]
    seen = bends_of(np.array([[upper, turn]]))[0, 0]
    true = bends_of(np.array([[UPRIGHT, turn]]))[0, 0]
    np.testing.assert_allclose(one("frame_misalignment", "bend", yaw=0.2).update(0.0, true), seen, atol=1e-12)


def test_a_rotation_and_its_vector_agree() -> None:
    for vector in np.random.default_rng(1).uniform(-1.7, 1.7, (20, 3)):
        np.testing.assert_allclose(quaternion_vector(vector_quaternion(vector)), vector, atol=1e-9)
    half = product(vector_quaternion(np.array([0.3, 0.0, 0.0])), vector_quaternion(np.array([0.2, 0.0, 0.0])))
    np.testing.assert_allclose(quaternion_vector(half), [0.5, 0.0, 0.0], atol=1e-12)
