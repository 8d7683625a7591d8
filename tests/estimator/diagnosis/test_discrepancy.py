"""Residuals with memory: coefficients, innovations and the test for what correlation is left."""

import numpy as np
import pytest
from scipy.stats import norm
from scipy.stats import t as student

from softarm.estimator.diagnosis.discrepancy import Autoregression, DiscountedVariance, ljung_box


def process(
    seed: int, memory: float, size: float = 1.0, samples: int = 400, count: int = 8
) -> list[np.ndarray]:
    """Draw stretches of a first-order process whose innovations have a standard deviation."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        left = rng.normal(0.0, size, samples)
        for k in range(1, samples):
            left[k] += memory * left[k - 1]
        found.append(left)
    return found


def test_innovations_of_unseen_stretches_are_white_and_of_unit_variance():
    learnt = Autoregression.fitted(process(1, 0.95, 0.3))
    own = [learnt.innovations(one) for one in process(2, 0.95, 0.3)]
    assert np.nanmean(np.concatenate(own) ** 2) == pytest.approx(1.0, abs=0.1)
    correlation, chance = ljung_box(own)
    assert abs(correlation) < 0.05
    assert chance > 0.01


def test_another_memory_or_size_shows():
    learnt = Autoregression.fitted(process(1, 0.5))
    slower = [learnt.innovations(one) for one in process(2, 0.95)]
    correlation, chance = ljung_box(slower)
    assert correlation > 0.3
    assert chance < 1e-6
    larger = [learnt.innovations(one) for one in process(3, 0.5, size=2.0)]
    assert np.nanmean(np.concatenate(larger) ** 2) == pytest.approx(4.0, rel=0.15)


@pytest.mark.parametrize(("samples", "count"), [(100, 3), (29, 30)])
def test_chances_are_even_where_nothing_is_correlated(samples: int, count: int):
    """However short the stretches are, no pair of samples reaches from one to the next."""
    chances = np.sort([ljung_box(process(seed, 0.0, samples=samples, count=count))[1] for seed in range(200)])
    assert np.abs(chances - np.linspace(0.0, 1.0, 200)).max() < 0.12


def bursts(seed: int, count: int = 8) -> list[np.ndarray]:
    """Draw stretches that are ten times louder for a second at a time."""
    rng = np.random.default_rng(seed)
    loud = [np.repeat(rng.choice([0.1, 1.0], 20, p=[0.7, 0.3]), 20) for _ in range(count)]
    return [one * rng.normal(size=one.size) for one in loud]


def test_where_the_noise_comes_in_bursts_innovations_are_of_unit_variance_in_and_between_them():
    learnt = Autoregression.fitted(bursts(1))
    assert learnt.variance.discount < 0.95
    quiet, loud = [], []
    for one in bursts(2):
        own = learnt.innovations(one)
        scale = np.abs(one[-len(own) :])
        louder = np.convolve(scale, np.ones(5) / 5, "same") > 0.3
        quiet.append(own[~louder])
        loud.append(own[louder])
    everything = np.concatenate([*quiet, *loud])
    assert np.mean(everything**2) == pytest.approx(1.0, abs=0.15)
    assert np.mean(np.concatenate(quiet) ** 2) > 0.4
    assert np.mean(np.concatenate(loud) ** 2) < 2.5


def test_the_variance_of_an_innovation_does_not_depend_on_it():
    learnt = DiscountedVariance(0.8, 4.0, 1.0)
    past = np.array([0.3, -1.0, 0.5])
    scores = [learnt.scores(np.append(past, last))[-1] for last in (-2.0, 2.0, 1.0)]
    assert scores[0] == pytest.approx(-scores[1])
    assert scores[1] > scores[2] > 0.0
    lost = learnt.scores(np.array([0.3, np.nan, -1.0, 0.5]))
    assert np.isnan(lost[1])
    assert lost[[0, 2, 3]] == pytest.approx(learnt.scores(past))


def test_a_stretch_that_stands_still_and_then_moves_has_finite_scores():
    scores = DiscountedVariance(0.5, 1.0, 1.0).scores(np.append(np.zeros(2000), 1.0))
    assert np.isfinite(scores).all()
    assert scores[-1] > 1.0


def test_scores_are_those_of_students_law():
    """At the first sample: the normal quantile of Student's distribution function of x / sqrt(S)."""
    learnt = DiscountedVariance(0.9, 5.0, 4.0)
    expected = norm.ppf(student.cdf(3.0 / 2.0, 5.0))
    assert learnt.scores(np.array([3.0]))[0] == pytest.approx(expected)


def test_an_even_noise_is_given_a_constant_variance():
    assert Autoregression.fitted(process(6, 0.5)).variance.discount == 1.0


def test_white_noise_is_given_no_memory():
    assert len(Autoregression.fitted(process(4, 0.0)).coefficients) <= 2


def test_lost_samples_and_short_stretches_are_left_out():
    parts = process(5, 0.9, samples=100)
    parts[0][10:20] = np.nan
    learnt = Autoregression.fitted([*parts, np.array([9.0, -9.0])])
    assert learnt.deviation == pytest.approx(1.0, abs=0.1)
    assert np.isnan(learnt.innovations(parts[0])).any()
    assert len(learnt.innovations(np.array([]))) == 0
    assert Autoregression.fitted([]).deviation == 0.0
    assert ljung_box([np.zeros(3)]) == (0.0, 1.0)


def test_what_never_changed_tells_nothing_of_what_does():
    still = Autoregression.fitted([np.zeros(100)])
    assert np.isnan(still.innovations(np.arange(10.0))).all()
