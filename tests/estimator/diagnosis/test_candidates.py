"""What counts as plain, distinguishable, moved or restated."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.diagnosis.candidates import (
    ALIKE,
    MOST_SURPRISE,
    SIGNIFICANT_Z,
    includes,
    is_distinguishable,
    is_moved,
    plainest_first,
    restates,
    surprise,
)
from softarm.estimator.diagnosis.fit import Fit
from softarm.estimator.effects import EFFECTS
from softarm.estimator.specimen.physics import Place
from tests.estimator.diagnosis.made import candidate, fit_of, hypothesis


def test_an_unexpected_size_costs_up_to_a_bound():
    spread = EFFECTS["tip_payload"].parameters[0].spread
    assert surprise(fit_of("tip_payload", 2.0 * spread)) == pytest.approx(4.0)
    assert surprise(fit_of("tip_payload", 20.0 * spread)) == MOST_SURPRISE


def test_of_equals_the_plainest_comes_first():
    plain, rich = fit_of("tip_payload", 0.01), fit_of("tether_stiffness", 5.0, 0.01, 0.0, 0.5)
    close = [candidate(rich, 100.0), candidate(plain, 100.0 - 0.9 * ALIKE)]
    assert plainest_first(close)[0].fit is plain
    apart = [candidate(rich, 100.0), candidate(plain, 100.0 - 1.1 * ALIKE)]
    assert plainest_first(apart)[0].fit is rich
    assert plainest_first([]) == []


def test_an_amplitude_is_distinguishable_from_zero_by_its_deviation():
    assert is_distinguishable(fit_of("tip_payload", 1.1 * SIGNIFICANT_Z, deviation=1.0), 0)
    assert not is_distinguishable(fit_of("tip_payload", 0.9 * SIGNIFICANT_Z, deviation=1.0), 0)


@pytest.mark.parametrize("ratio", [0.9, 1.1])
def test_a_law_with_a_free_exponent_is_judged_by_its_likelihood(ratio):
    """Softening at small bends: amplitude and exponent trade against each other, and either is unsure."""
    law = hypothesis("material_softening", Place(segment="lower"))
    growth, exponent = 2.0, 1.5
    bends = np.linspace(0.05, 0.3, 40)
    shown = growth * bends**exponent
    scales = [law.effect.parameters[0].scale, exponent]  # the exponent is fitted as a logarithm
    slopes = np.column_stack([bends**exponent, shown * np.log(bends)]) * scales
    two = 11.83  # of chi-square with two degrees of freedom, as improbable as three deviations of one
    noise = np.sqrt(float(shown @ shown) / two) / np.sqrt(ratio)
    covariance = noise**2 * np.linalg.inv(slopes.T @ slopes)
    fit = Fit((law,), (np.array([growth, exponent]),), covariance, 100.0)
    assert growth / fit.stds(0)[0] < 1.5
    assert is_distinguishable(fit, 0) is (ratio > 1.0)


@pytest.mark.parametrize(("share", "moved"), [(0.9, False), (1.1, True), (-1.1, True)])
def test_an_effect_has_moved_by_more_than_its_deviation(share, moved):
    then = fit_of("tip_payload", 0.03, deviation=0.002)
    later = fit_of("chamber_gain", 0.1)
    now = later.joined(fit_of("tip_payload", 0.03 + share * 0.002))
    assert is_moved(now, 1, then) is moved


def test_a_law_includes_a_plainer_one_that_is_part_of_it():
    """A leak may be behind a narrow line: then that line is late, whichever law is chosen."""

    def fitted(name: str, chamber: int, *theta: float) -> Fit:
        return replace(fit_of(name, *theta), hypotheses=(hypothesis(name, Place(chamber=chamber)),))

    late, leak = fitted("line_lag", 1, 0.2), fitted("line_leak", 1, 0.1, 0.2, 1.0)
    assert includes(leak, late)
    assert not includes(leak, fitted("line_lag", 1, -0.2))
    assert not includes(late, leak)
    assert not includes(fitted("line_leak", 2, 0.1, 0.2, 1.0), late)
    assert not includes(fitted("line_leak", 1, 0.1, 0.9 * SIGNIFICANT_Z * 1e-3, 1.0), late)


def test_a_law_that_says_no_more_than_a_plainer_one_restates_it():
    """A leak that loses nothing is a late line."""
    place = Place(chamber=1)

    def leak(share: float) -> Fit:
        return replace(fit_of("line_leak", share, 0.2, 1.0), hypotheses=(hypothesis("line_leak", place),))

    late = replace(fit_of("line_lag", 0.2), hypotheses=(hypothesis("line_lag", place),))
    elsewhere = replace(fit_of("line_lag", 0.2), hypotheses=(hypothesis("line_lag", Place(chamber=2)),))
    assert restates(leak(0.9 * SIGNIFICANT_Z * 1e-3), late)
    assert not restates(leak(1.1 * SIGNIFICANT_Z * 1e-3), late)
    assert not restates(leak(0.0), elsewhere)
    assert not restates(late, leak(0.0))
