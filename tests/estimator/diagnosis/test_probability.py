"""Probabilities of explanations mean what they say, even where a noise model is far too sure."""

import numpy as np
import pytest
from scipy.special import softmax

from softarm.estimator.diagnosis.candidates import Candidate
from softarm.estimator.diagnosis.fit import Fit
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.diagnosis.probability import (
    CREDIBLE,
    credible_set,
    groups_of_alike,
    pseudo_bma,
    shared,
)
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import Place

FOLDS = 10


def weights(*densities: np.ndarray) -> np.ndarray:
    return pseudo_bma(np.column_stack(densities), np.random.default_rng(0))


def test_what_predicts_every_fold_better_is_certain():
    assert weights(np.full(FOLDS, 5.0), np.zeros(FOLDS)) == pytest.approx([1.0, 0.0], abs=1e-3)


def test_explanations_that_predict_alike_share_the_probability():
    folds = np.random.default_rng(1).normal(-50.0, 20.0, FOLDS)
    assert weights(folds, folds) == pytest.approx([0.5, 0.5])


def test_one_fold_does_not_make_certain_what_the_others_contradict():
    """The odds of the sum are e^26 to one."""
    once = np.array([80.0, *np.full(FOLDS - 1, -6.0)])
    assert softmax([once.sum(), 0.0])[0] > 0.999
    assert 0.5 < weights(once, np.zeros(FOLDS))[0] < 0.9


def test_stated_probabilities_are_those_of_being_right():
    """Of two explanations that are both wrong, the better one is known only as far as the folds agree."""
    rng = np.random.default_rng(2)
    better = rng.normal(0.0, 30.0, 600)
    stated = np.array(
        [pseudo_bma(np.stack([rng.normal(own, 60.0, FOLDS), np.zeros(FOLDS)], 1), rng)[0] for own in better]
    )
    for low, high in ((0.0, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 1.0)):
        own = (stated >= low) & (stated <= high)
        assert (better[own] > 0.0).mean() == pytest.approx(stated[own].mean(), abs=0.1)


def fitted(name: str, gain: float, place: Place) -> Candidate:
    theta = np.array([parameter.typical for parameter in EFFECTS[name].parameters])
    fit = Fit((Hypothesis(EFFECTS[name], place),), (theta,), np.eye(len(theta)), gain)
    return Candidate(0, fit, gain)


@pytest.mark.parametrize(
    ("rival", "gain", "alike"),
    [("line_leak", 101.0, True), ("line_leak", 110.0, False), ("line_lag", 100.0, False)],
)
def test_of_one_class_what_fits_alike_is_as_likely(rival: str, gain: float, alike: bool) -> None:
    where = Place(chamber=1)
    field = [fitted("chamber_gain", 100.0, where), fitted(rival, gain, where)]
    expected = [0.5, 0.5] if alike else [0.95, 0.05]
    assert shared(np.array([0.95, 0.05]), groups_of_alike(field)) == pytest.approx(expected)


def test_a_credible_set_holds_the_likeliest_and_no_more_than_needed():
    weighed = {
        ("line_leak", Place(chamber=1)): 0.03,
        ("chamber_gain", Place(chamber=1)): 0.6,
        ("pressure_bias", Place(chamber=1)): 0.36,
    }
    assert {name for name, _ in credible_set(weighed)} == {"chamber_gain", "pressure_bias"}
    assert CREDIBLE <= 0.6 + 0.36
