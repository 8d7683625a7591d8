"""Statistics that several estimates share, against their definitions."""

import numpy as np
import pytest

from softarm.estimator.arc import arc_over_chord
from softarm.estimator.statistics import (
    HUBER,
    MAD_TO_STD,
    correlation_length,
    huber_loss,
    huber_weight,
    weighted_median,
)

RANDOM = np.random.default_rng(2)


def test_the_weight_is_half_the_slope_of_the_loss_over_the_residual() -> None:
    sizes = np.array([-4.0, -1.6, -0.3, 0.7, 1.4, 2.5])
    step = 1e-6
    slope = (huber_loss(sizes + step) - huber_loss(sizes - step)) / (2.0 * step)
    np.testing.assert_allclose(huber_weight(sizes), 0.5 * slope / sizes, rtol=1e-6)
    assert huber_loss(np.array([HUBER]))[0] == pytest.approx(HUBER**2)


def test_the_correlation_length_of_a_first_order_process_is_that_of_theory() -> None:
    decay, values = 0.8, np.zeros(200_000)
    noise = RANDOM.normal(size=len(values))
    for k in range(1, len(values)):
        values[k] = decay * values[k - 1] + noise[k]
    assert correlation_length(values) == pytest.approx((1.0 + decay) / (1.0 - decay), rel=0.1)
    assert correlation_length(noise) == pytest.approx(1.0, abs=0.2)
    assert correlation_length(np.zeros(50)) == 1.0


def test_the_median_deviation_gives_the_standard_deviation() -> None:
    noise = RANDOM.normal(0.0, 3.0, 20_000)
    assert MAD_TO_STD * weighted_median(np.abs(noise), np.ones(len(noise))) == pytest.approx(3.0, rel=0.03)
    assert weighted_median(np.array([1.0, 2.0, 9.0]), np.array([1.0, 1.0, 5.0])) == 9.0


def test_an_arc_over_its_chord_and_its_slope() -> None:
    angles = np.array([1e-5, 9e-4, 1.1e-3, 0.4, 2.0])
    ratio, slope = arc_over_chord(angles)
    np.testing.assert_allclose(ratio, 0.5 * angles / np.sin(0.5 * angles), rtol=1e-10)
    ends = [arc_over_chord(angles * (1.0 + sign * 1e-5))[0] for sign in (1, -1)]
    differences = (ends[0] - ends[1]) / (2e-5 * angles)
    np.testing.assert_allclose((slope * angles)[2:], differences[2:], rtol=1e-4)
