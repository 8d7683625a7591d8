"""Probabilities of explanations mean what they say, even where a noise model is far too sure."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.special import softmax

from softarm.estimator.diagnosis.candidates import (
    Candidate,
)
from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.fit import Fit
from softarm.estimator.diagnosis.judge import (
    FoldCosts,
)
from softarm.estimator.diagnosis.library import Hypothesis
from softarm.estimator.diagnosis.probability import (
    CREDIBLE,
    credible_set,
    groups_of_alike,
    probabilities,
    pseudo_bma,
    shared,
)
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.made import (
    candidate,
    fit_of,
)

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


@pytest.mark.parametrize(("least", "sure"), [(0.0, True), (4000.0, False)])
def test_a_hundredth_of_the_gain_makes_nobody_sure(least, *, sure):
    """A law that is a tenth wrong leaves as much in all folds; the same gain over nothing decides."""
    none = np.full(5, 400.0)
    costs = [
        FoldCosts(none, none, none, none, np.full(5, total / 5), 0.0 * none)
        for total in (least, least + 40.0)
    ]
    field = [candidate(fit_of("tip_payload", 0.01), 100.0, number) for number in (0, 1)]
    likelier = probabilities(field, costs, 5.0, np.random.default_rng(0))[1]
    assert bool(likelier > CREDIBLE) is sure
    assert likelier > 0.5


@pytest.mark.parametrize(("usual", "likeliest"), [(0.0, 0), (300.0, 1), (2000.0, 1)])
def test_explanations_are_compared_with_what_every_arm_may_have_of_them(usual, likeliest):
    """Most of a drift every arm may have; it still explains more than a lost gain that no arm has."""
    none = np.full(5, 400.0)
    gains = (np.full(5, 40.0), np.full(5, 20.0))
    shares = (np.zeros(5), np.full(5, usual / 5))
    costs = [FoldCosts(none, none, none, none, *one) for one in zip(gains, shares, strict=True)]
    field = [candidate(fit_of("tip_payload", 0.01), 100.0, number) for number in (0, 1)]
    probable = probabilities(field, costs, 5.0, np.random.default_rng(0))
    assert probable[likeliest] > 0.9
    likely = Search.likely(
        cast(
            "Any",
            SimpleNamespace(
                rng=np.random.default_rng(0),
                bic_penalty=5.0,
                predicted=lambda one, _: costs[one.number],
                only_moves=lambda _: False,
            ),
        ),
        field,
        None,
    )
    assert likely[0].number == likeliest


def test_no_change_is_likeliest_where_a_usual_share_explains_as_much():
    none = np.full(5, 400.0)
    field = [candidate(fit_of("tip_payload", 0.01), 100.0, number) for number in (0, 1)]
    gains, shares = (np.full(5, 40.0), np.zeros(5)), (np.zeros(5), np.full(5, 60.0))
    costs = [FoldCosts(none, none, none, none, *one) for one in zip(gains, shares, strict=True)]
    assert probabilities(field, costs, 5.0, np.random.default_rng(0)).sum() < 0.1


def test_an_unlikely_size_makes_an_explanation_less_probable():
    none = np.full(5, 400.0)
    costs = [FoldCosts(none, none, none, none, np.full(5, 20.0), 0.0 * none)] * 2
    spread = EFFECTS["tip_payload"].parameters[0].spread
    field = [candidate(fit_of("tip_payload", size * spread), 100.0, 0) for size in (0.1, 2.0)]
    usual, unlikely = probabilities(field, costs, 5.0, np.random.default_rng(0))
    assert usual > 5.0 * unlikely


def test_the_natural_frequency_counts_where_the_arm_at_rest_looks_alike():
    """A weight and a force bend the arm alike; only the weight changes how fast it vibrates."""
    none = np.full(5, 400.0)
    search = SimpleNamespace(
        rng=np.random.default_rng(0),
        bic_penalty=5.0,
        predicted=lambda one, _: FoldCosts(
            none, none, none, none, none, 0.0 * none, (0.0, 1500.0)[one.number]
        ),
        only_moves=lambda _: False,
    )
    field = [candidate(fit_of("tip_payload", 0.01), 100.0, number) for number in (0, 1)]
    likely = Search.likely(cast("Any", search), field, None)
    assert [one.number for one in likely] == [1]
