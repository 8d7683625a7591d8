"""A candidate is judged by what it predicts where it was not fitted."""

from dataclasses import replace

import numpy as np
import pytest

from softarm.estimator.diagnosis.folds import Folds
from softarm.estimator.diagnosis.gaussian import NOTHING, Gaussian
from softarm.estimator.diagnosis.judge import (
    CERTAIN,
    Judgement,
    bootstrap,
    fold_costs,
    judge,
)
from softarm.estimator.diagnosis.normal_equations import (
    NewColumns,
    NormalEquations,
    normal_equations,
)
from tests.estimator.diagnosis.made import RUNS, SAMPLES, judgement


@pytest.mark.parametrize(
    ("changes", "accepted"),
    [
        ({}, True),
        ({"gain_ci95": (-0.1, 0.7)}, False),
        ({"gain_ci95": (0.0, 0.7)}, True),
        ({"gain_ci95": (-0.1, 0.7), "delta_bic": 1.01 * CERTAIN}, True),
        ({"gain_ci95": (-0.1, 0.7), "delta_bic": 1.01 * CERTAIN, "after": 3.1}, False),
        ({"share": 0.05}, True),
        ({"share": 0.05, "change": 0.5}, False),
        ({"search_p": 0.02}, False),
    ],
)
def test_a_candidate_is_accepted_where_it_holds_is_material_and_no_chance(changes, accepted):
    assert judgement(**changes).accepted is accepted


def recordings(sizes: list[float], noise: float = 1.0) -> list[NormalEquations]:
    """Recordings with one common column, and one of a candidate whose size differs between them."""
    found = []
    for number, size in enumerate(sizes):
        rng = np.random.default_rng([7, number])
        columns = rng.normal(size=(SAMPLES, 1, 2))
        residual = size * columns[..., 1] + noise * rng.normal(size=(SAMPLES, 1))
        none = np.zeros(SAMPLES, dtype=bool)
        blocks = np.zeros(SAMPLES, dtype=int)
        found += normal_equations(residual, columns, np.ones(1), blocks, none, none, number, nominal=False)
    return found


def judged_on(parts: list[NormalEquations]) -> Judgement:
    common = [replace(part, matrix=part.matrix[:1, :1], vector=part.vector[:1]) for part in parts]
    new = [NewColumns(part.matrix[:1, 1:], part.matrix[1:, 1:], part.vector[1:]) for part in parts]
    folds = Folds.of(common, Gaussian(np.zeros(1), 1e-4 * np.eye(1)), 1.0)
    changed = np.array([sum(new[k].matrix[0, 0] for k in fold) for fold in folds.numbers])
    costs = fold_costs(folds.marginal(folds.columns(new)), NOTHING, changed)
    return judge(costs, np.random.default_rng(0), 0.0, 50.0)


def judged(sizes: list[float]) -> Judgement:
    return judged_on(recordings(sizes))


def test_a_size_that_every_recording_shows_predicts_the_others():
    found = judged([2.0] * RUNS)
    assert found.after == pytest.approx(1.0, abs=0.15)
    assert found.before == pytest.approx(np.sqrt(5.0), rel=0.15)
    assert found.accepted


def test_sizes_that_contradict_each_other_are_not_one_effect():
    found = judged([2.0, -2.0, 2.0, -2.0, 2.0])
    assert found.after > found.before
    assert not found.accepted


def test_nothing_is_no_effect():
    assert not judged([0.0] * RUNS).accepted


def test_the_bootstrap_of_a_gain_covers_it():
    rng = np.random.default_rng(1)
    before, after = rng.chisquare(50, 12) * 4.0, rng.chisquare(50, 12)
    low, high = bootstrap(rng, before, after)
    assert low < 1.0 - np.sqrt(after.sum() / before.sum()) < high
    assert high - low < 0.2


def test_two_recordings_are_judged_by_spans_of_time():
    """Each span is predicted from the others: a size that only one span shows is no effect."""

    def spans(sizes: list[float]) -> list[NormalEquations]:
        parts = recordings(sizes)
        return [replace(part, session=number // 3, block=number) for number, part in enumerate(parts)]

    steady, once = (judged_on(spans(sizes)) for sizes in ([2.0] * 5, [2.0, 0.0, 0.0, 0.0, 0.0]))
    assert steady.accepted
    assert not once.accepted


def test_a_candidate_that_changes_nothing_is_not_accepted():
    parts = recordings([0.0] * RUNS)
    for part in parts:
        part.matrix[-1], part.matrix[:, -1], part.vector[-1] = 0.0, 0.0, 0.0
    found = judged_on(parts)
    assert found.after == pytest.approx(found.before)
    assert not found.accepted
