"""How often recordings show an effect, and what is asked of one that was seen once."""

from typing import Any, cast

import numpy as np
import pytest

from softarm.estimator.diagnosis.choose import Search
from softarm.estimator.diagnosis.excursions import PAUSE_S, excursions_of, samples_near_one_pose
from softarm.estimator.diagnosis.judge import CERTAIN, Judgement

TIME = np.arange(0.0, 60.0, 0.1)
STAYS = 80.0
"""Samples in which the arm stays near one pose: 8 s."""


def acting(*spans: tuple[float, float]) -> np.ndarray:
    """Weighted squares of 4 during some spans of time [s], and of next to nothing else."""
    squares = np.full(len(TIME), 1e-4)
    for begin, end in spans:
        squares[np.abs(TIME - 0.5 * (begin + end) + 0.05) < 0.5 * (end - begin)] = 4.0
    return squares


def number(squares: np.ndarray) -> float:
    return excursions_of([(TIME, squares, STAYS)]).number


def test_poses_one_after_the_other_are_as_many_looks_while_an_effect_acts_all_along() -> None:
    assert number(acting((5.0, 45.0))) == pytest.approx(5.0)
    assert number(acting((5.0, 20.0))) == pytest.approx(1.0)


@pytest.mark.parametrize("hold", [2.0, 6.0])
def test_an_arm_that_takes_a_pose_after_the_other_stays_near_one_for_about_a_hold(hold: float) -> None:
    rng = np.random.default_rng(3)
    poses = np.repeat(rng.normal(size=(200, 2)), round(hold / 0.1), axis=0)[:2000]
    poses[::7] = np.nan
    poses = np.column_stack([poses, np.full(len(poses), np.nan)])  # an axis that was lost throughout
    assert 0.1 * samples_near_one_pose(poses) == pytest.approx(hold, rel=0.5)


def test_excursions_of_one_length_count_alike() -> None:
    found = excursions_of(
        [(TIME, acting((5.0, 9.0), (20.0, 24.0)), STAYS), (TIME, acting((30.0, 34.0)), STAYS)]
    )
    assert found.number == pytest.approx(3.0)
    assert found.samples == pytest.approx(40.0)
    assert not found.once


def test_a_short_pause_does_not_end_an_excursion() -> None:
    short, long = 0.5 * PAUSE_S, 2.0 * PAUSE_S
    assert number(acting((5.0, 9.0), (9.0 + short, 13.0))) == pytest.approx(1.0)
    assert number(acting((5.0, 9.0), (9.0 + long, 13.0 + long))) == pytest.approx(2.0)


def test_what_another_excursion_hardly_shows_was_seen_once() -> None:
    found = excursions_of([(TIME, acting((5.0, 9.0), (20.0, 20.4)), STAYS)])
    assert 1.0 < found.number < 1.5
    assert found.once


def test_an_effect_that_acts_nowhere_was_not_seen() -> None:
    assert excursions_of([(TIME, np.zeros(len(TIME)), STAYS)]).once
    assert excursions_of([]).once


@pytest.mark.parametrize(
    ("spans", "gain", "accepted"),
    [
        (((5.0, 9.0), (20.0, 24.0)), 1.1 * CERTAIN, True),
        (((5.0, 9.0),), 1.1 * CERTAIN, False),
        (((5.0, 9.0),), 9.0 * CERTAIN, True),
    ],
)
def test_samples_of_the_only_excursion_are_one(monkeypatch, spans, gain, *, accepted: bool) -> None:
    """With a fifth of all samples independent, forty samples are eight: their gain must be eight times it."""
    certain = Judgement(2.0, 1.0, (0.1, 0.3), 0.9, 1.0, 0.0, gain)
    monkeypatch.setattr("softarm.estimator.diagnosis.choose.judge", lambda *_: certain)
    search = cast("Any", Search.__new__(Search))
    for name, value in {
        "rng": None,
        "weights": type("Weights", (), {"effective_sample_fraction": 0.2}),
        "predicted": lambda *_: None,
        "weighted_squares": lambda *_: [(TIME, acting(*spans), STAYS)],
    }.items():
        object.__setattr__(search, name, value)
    candidate = cast("Any", type("Candidate", (), {"delta_bic": gain}))
    assert search.judge(candidate, None, np.zeros(5)).accepted is accepted
