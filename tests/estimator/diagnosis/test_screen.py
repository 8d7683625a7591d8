"""The screen ranks by what effects explain, and knows what chance explains."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from softarm.estimator.diagnosis.library import Direction, Library
from softarm.estimator.diagnosis.marginal import Marginal, null_draws
from softarm.estimator.diagnosis.screen import null_scores, screen, usual_gains
from tests.estimator.diagnosis.made import hypothesis


def test_what_a_usual_share_of_each_effect_explains():
    evidence = cast("Any", SimpleNamespace(nuisances=1, effects=["tip_payload", "hysteresis", "hysteresis"]))
    shift, covariance = np.array([9.0, 1.0, 0.2, 3.0]), np.diag([1.0, 1.0, 0.01, 0.5])
    marginal = Marginal(np.eye(4), np.zeros(4), 500.0, 400.0, shift, covariance)
    assert usual_gains(evidence, marginal) == pytest.approx({"tip_payload": 1.0, "hysteresis": 22.0})


def test_the_screen_ranks_by_gain_and_refuses_sizes_of_the_wrong_sign(library):
    evidence = cast("Any", SimpleNamespace(nuisances=0, library=library))
    marginal = Marginal(
        np.diag([100.0, 100.0, 100.0]), np.array([40.0, -80.0, 60.0]), 500.0, 400.0, np.zeros(3), np.eye(3)
    )
    ranked = screen(evidence, marginal, frozenset())
    assert [number for number, *_ in ranked] == [2, 0, 1]
    assert ranked[0][1] == pytest.approx(36.0 - np.log(400.0), rel=1e-4)
    assert ranked[0][2] == pytest.approx([0.6 * 0.08], rel=1e-4)
    assert ranked[-1][1] < 0.0  # a cord does not push
    assert {number for number, *_ in screen(evidence, marginal, frozenset({2}))} == {0, 1}


def test_chances_of_the_search_are_even_or_cautious_where_nothing_is_missing(library):
    evidence = cast("Any", SimpleNamespace(nuisances=0, library=library))
    rng = np.random.default_rng(2)
    root = rng.normal(size=(3, 3))
    matrix = 50.0 * (root @ root.T + np.eye(3))
    plain = Marginal(matrix, np.zeros(3), 500.0, 400.0, np.zeros(3), np.eye(3))
    null = null_scores(evidence, plain, rng)
    chances = []
    for drawn in null_draws(plain.matrix, rng, 400):
        marginal = Marginal(matrix, drawn, 500.0, 400.0, np.zeros(3), np.eye(3))
        best = screen(evidence, marginal, frozenset())[0][1]
        chances.append(float((null >= best).mean()))
    for level in (0.01, 0.05, 0.2):
        assert np.mean(np.array(chances) <= level) < level + 3.0 * np.sqrt(level / 400.0)


def test_something_present_does_not_pull_where_it_can_only_push():
    wall = Library(
        (hypothesis("contact_obstacle"),), (Direction(0, 0, -1, np.array([30.0, 0.01, 0.0]), 1.0, 1.0),)
    )
    evidence = cast("Any", SimpleNamespace(nuisances=0, library=wall))
    scores = []
    for sign in (1.0, -1.0):
        marginal = Marginal(
            np.array([[100.0]]), np.array([sign * 80.0]), 500.0, 400.0, np.zeros(1), np.eye(1)
        )
        ((_, score, theta),) = screen(evidence, marginal, frozenset())
        assert theta == pytest.approx([30.0, 0.01, 0.0])
        scores.append(score)
    assert scores[0] > 0.0 > scores[1]
