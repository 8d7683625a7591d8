"""What was accepted has to hold on data that no fit has seen."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from softarm.estimator.diagnosis import confirm
from softarm.estimator.diagnosis.candidates import (
    Accepted,
    ChosenEffects,
)
from softarm.estimator.diagnosis.confirm import lost_by_chance, unproven
from softarm.estimator.diagnosis.gaussian import Gaussian
from softarm.estimator.diagnosis.normal_equations import (
    NormalEquations,
    normal_equations,
    with_columns,
)
from tests.estimator.diagnosis.made import (
    SAMPLES,
    candidate,
    chosen,
    fit_of,
    judgement,
)


def confirming(*left: float) -> list[NormalEquations]:
    """Stretches that confirm, with residuals of these sizes in turn."""
    found = []
    for number in range(8):
        rng = np.random.default_rng([11, number])
        residual = left[number % len(left)] + rng.normal(size=(SAMPLES, 1))
        held = np.ones(SAMPLES, dtype=bool)
        blocks, none = np.zeros(SAMPLES, dtype=int), np.zeros(SAMPLES, dtype=bool)
        columns = rng.normal(size=(SAMPLES, 1, 1))
        found += normal_equations(residual, columns, np.ones(1), blocks, held, none, number, nominal=False)
    return found


MOSTLY_WORSE = ((2.0, *[0.0] * 7), (0.0, *[0.4] * 7))
"""Residuals without and with an effect that shows in one stretch of eight."""


ONCE_BETTER = ((3.0, *[0.0] * 7), (0.0, *[0.4] * 7))
"""The same where that one alone gains as much as the effect's size says, but for chance."""


@pytest.mark.parametrize(
    ("before", "after", "shown", "lost"),
    [
        ((1.0,), (0.0,), 1.0, []),
        ((1.0,), (1.0,), 1.0, [0]),
        ((1.0,), (1.0,), 0.0, []),
        (*MOSTLY_WORSE, 0.5, []),
        (*MOSTLY_WORSE, 1.0, [0]),
        (*ONCE_BETTER, 1.0, []),
    ],
)
def test_an_effect_has_to_predict_the_confirming_stretches_if_it_would_show_there(before, after, shown, lost):
    """All together as well as its size says, or any that are drawn better than without it."""
    fit = fit_of("tip_payload", 0.02)

    def products(weights, more, parts, left):
        change = np.full((SAMPLES, 1, 1), shown)
        none = np.zeros(SAMPLES, dtype=int)
        common, left = np.zeros((SAMPLES, 1, 1)), np.zeros((SAMPLES, 1))
        return [new for own in parts for new in with_columns([own], left, common, change, np.ones(1), none)]

    search = SimpleNamespace(
        left=lambda own: SimpleNamespace(parts=confirming(*(before if own is None else after)), residuals=[]),
        prior=Gaussian(np.zeros(1), 1e-4 * np.eye(1)),
        weights=SimpleNamespace(effective_sample_fraction=1.0),
        evidence=SimpleNamespace(size=1, with_columns=products),
        rng=np.random.default_rng(0),
        subset=lambda _, kept: None if not kept else fit,
    )
    assert unproven(cast("Any", search), chosen(fit)) == lost
    if lost:  # of several that fail together the weakest
        search.contribution = lambda _, number: [90.0, 40.0][number]
        assert unproven(cast("Any", search), chosen(fit, fit_of("chamber_gain", 0.1))) == [1]


def test_stretches_in_which_an_effect_hardly_shows_may_by_chance_gain_less_than_nothing():
    """The gain of an effect that acts is normal with mean g and deviation 2 sqrt(g)."""
    expected = np.array([60.0, 5.0, 1.0])
    assert lost_by_chance(expected, [0, 1, 2]) == 0.0
    assert lost_by_chance(expected, [2]) == pytest.approx(3.0)
    assert lost_by_chance(expected, [1, 2, 2]) == pytest.approx(4.0 * 9.0**0.5 - 7.0)
    gains = expected + 2.0 * np.sqrt(expected) * np.random.default_rng(5).normal(size=(20000, 3))
    for number in (1, 2):
        assert (gains[:, number] + lost_by_chance(expected, [number]) < 0.0).mean() < 0.03


@pytest.mark.parametrize(
    ("instead", "stands", "dropped"),
    [
        (120.0, ["distributed_mass"], ["tip_payload"]),
        (80.0, [], ["tip_payload", "distributed_mass"]),
        (None, [], ["tip_payload"]),
    ],
)
def test_what_takes_the_place_of_a_choice_that_failed_has_to_explain_more(
    monkeypatch, instead, stands, dropped
):
    def choice(name: str, number: int) -> ChosenEffects:
        one = candidate(fit_of(name, 0.02), 100.0, number)
        return ChosenEffects((Accepted(one, judgement(), ()),), one.fit, 0.0, None)

    def names(accepted: Sequence[Accepted]) -> list[str]:
        return [one.candidate.fit.hypotheses[0].name for one in accepted]

    failing, holding = choice("tip_payload", 0), choice("distributed_mass", 1)
    found = [failing, holding] if instead is not None else [failing]
    search = SimpleNamespace(
        run=lambda without: found[len(without)] if len(without) < len(found) else chosen(),
        without=lambda choice, lost: chosen() if lost else choice,
    )
    gains = {"tip_payload": 100.0, "distributed_mass": instead}
    monkeypatch.setattr(confirm, "unproven", lambda _, choice, __: [0] if choice is failing else [])
    monkeypatch.setattr(
        confirm, "gain_of_all", lambda _, choice: sum(gains[name] for name in names(choice.accepted))
    )
    held, lost = confirm.proven(cast("Any", search))
    assert names(held.accepted) == stands
    assert names(lost) == dropped


def test_without_confirming_stretches_nothing_is_unproven():
    search = cast(
        "Any", SimpleNamespace(left=lambda _: SimpleNamespace(parts=[]), rng=np.random.default_rng(0))
    )
    assert unproven(search, chosen(fit_of("tip_payload", 0.02))) == []
