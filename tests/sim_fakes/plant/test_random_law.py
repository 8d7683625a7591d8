"""Laws drawn at random: no push at rest, one scale, memory, and every seed another."""

import numpy as np
import pytest

from softarm.fakes.plant.random_law import PRESSURE, RandomLaw

STEP = 0.0025


def pushes(seed: int, states: int = 200) -> np.ndarray:
    law = RandomLaw.draw(1e3, seed, ((0, 1, 2), (3, 4, 5)))
    rng = np.random.default_rng(0)
    return np.array(
        [law.push(rng.uniform(0.0, PRESSURE, 6), rng.normal(0.0, 0.4, (2, 2)), 10.0) for _ in range(states)]
    )


def test_nothing_is_pushed_at_rest():
    law = RandomLaw.draw(1e3, 3, ((0, 1, 2), (3, 4, 5)))
    assert law.push(np.zeros(6), np.zeros((2, 2)), STEP) == pytest.approx(0.0, abs=1e-9)


def test_the_push_is_of_the_stated_size_along_one_direction():
    sizes = []
    for seed in range(20):
        pushed = pushes(seed)
        assert np.linalg.matrix_rank(pushed, tol=1e-6) == 1
        sizes.append(float(np.sqrt((pushed**2).sum(axis=1).mean())))
    assert 0.5e3 < np.median(sizes) < 2e3


def test_every_seed_is_another_law():
    assert not np.allclose(pushes(1), pushes(2))
    assert np.array_equal(pushes(1), pushes(1))


def test_past_pressures_are_forgotten_with_the_stated_time():
    law = RandomLaw.draw(1e3, 1, ((0, 1, 2), (3, 4, 5)))
    full = np.full(6, PRESSURE)
    law.push(full, np.zeros((2, 2)), law.time)
    assert law.past == pytest.approx((1.0 - np.exp(-1.0)) * full)
