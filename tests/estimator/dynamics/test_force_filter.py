"""A point mass on a spring, seen through the force that would hold it where it is."""

import numpy as np
import pytest

from softarm.estimator.arrays import Floats
from softarm.estimator.dynamics.force_filter import ForceFilter
from softarm.estimator.dynamics.reduced_arm import ReducedArm

MASS, STIFFNESS, NOISE = 0.06, 10.0, 2e-3
STEP = 0.01
OMEGA = np.sqrt(STIFFNESS / MASS)


def seen(place: float, noise: float, unloaded: float = 0.0) -> ReducedArm:
    """Measure the holding force of a mass at a place."""
    force = STIFFNESS * (place - unloaded) + noise
    return ReducedArm(
        np.array([[STIFFNESS]]),
        np.array([[MASS]]),
        np.array([unloaded + force / STIFFNESS]),
        np.array([unloaded]),
        np.array([force]),
        np.array([[NOISE**2]]),
        np.arange(1),
        1.0,
        float(np.sqrt(STIFFNESS / MASS)),
    )


def follow(places: Floats, seed: int = 0) -> tuple[Floats, Floats]:
    """Return the filter's force and its deviation at each instant."""
    noise = np.random.default_rng(seed).normal(0.0, NOISE, len(places))
    at = ForceFilter.begin(seen(places[0], noise[0]))
    found = []
    for place, error in zip(places[1:], noise[1:], strict=True):
        at = at.at(seen(place, error), STEP)
        mean, covariance = at.forces
        found.append((mean[0], np.sqrt(covariance[0, 0])))
    return tuple(np.array(found).T)


def swung(forces: Floats, damping_ratio: float) -> Floats:
    """Let the mass move under a force, in steps a hundred times finer than the filter's."""
    place, speed, places = forces[0] / STIFFNESS, 0.0, []
    fine = STEP / 100
    for force in forces:
        for _ in range(100):
            speed += fine * ((force - STIFFNESS * place) / MASS - 2.0 * damping_ratio * OMEGA * speed)
            place += fine * speed
        places.append(place)
    return np.array(places)


@pytest.mark.parametrize("damping_ratio", [0.03, 0.06, 0.12])
def test_an_arm_that_swings_freely_is_pushed_by_nothing(damping_ratio: float) -> None:
    time = np.arange(0.0, 3.0, STEP)
    swing = 0.03 * np.exp(-damping_ratio * OMEGA * time) * np.cos(OMEGA * time)
    found, _ = follow(swing)
    later = time[1:] > 0.5
    held = STIFFNESS * np.abs(swing[1:])
    assert np.abs(found[later]).mean() < 0.25 * held[later].mean()


def test_an_arm_at_rest_is_held_by_the_measured_force() -> None:
    found, deviation = follow(np.full(300, 0.05))
    assert found[100:].mean() == pytest.approx(0.5, abs=NOISE)
    assert found[100:].std() < 2.0 * NOISE
    assert np.median(deviation[100:]) < 8.0 * NOISE


def test_a_push_is_found_though_the_arm_swings_under_it() -> None:
    forces = np.concatenate([np.zeros(100), np.full(100, 0.4)])
    found, deviation = follow(swung(forces, 0.06))
    after = slice(125, None)
    np.testing.assert_allclose(found[after], 0.4, atol=0.06)
    assert (np.abs(found[after] - 0.4) < 3.0 * deviation[after]).all()


def test_a_force_that_rises_evenly_is_not_followed_late() -> None:
    """As a gauge on a stage pulls: a lag of 10 ms would be 2 mN."""
    slope, damping_ratio = 0.2, 0.12
    forces = slope * np.maximum(0.0, np.arange(0.0, 4.0, STEP) - 1.0)
    lag = np.mean([follow(swung(forces, damping_ratio), seed)[0][200:] - forces[201:] for seed in range(4)])
    assert abs(lag) < 0.01 * slope


def test_deviations_are_true_of_forces_that_rest_wander_and_jump() -> None:
    rng = np.random.default_rng(3)
    rates = np.repeat(rng.choice([0.0, 0.1, 1.0], 60), 50)
    forces = np.cumsum(rates * np.sqrt(STEP) * rng.normal(size=len(rates)))
    found, deviation = follow(swung(forces, 0.06), seed=4)
    inside = np.abs(found - forces[1:]) < 2.0 * deviation
    assert 0.90 < inside.mean() < 0.995
