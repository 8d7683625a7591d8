"""Readings that keep an offset after a loss, on synthetic recordings of two pressures."""

import numpy as np
import pytest

from softarm.estimator.arrays import Floats
from softarm.estimator.intake.law import CORRELATION, Predictors, fit_variances, precision
from softarm.estimator.intake.relocated import relocation

STEP, LOST, OFFSET, NOISE = 0.1, 30.0, 0.5, 0.02
TIME = np.arange(0.0, 60.0, STEP)
SEEN = (TIME <= LOST - 1.0) | (TIME > LOST)
LEAST = np.array([0.1])
SWEEPS = 0.5 + 0.5 * np.column_stack([np.sin(0.7 * TIME) * np.cos(0.11 * TIME), np.sin(0.4 * TIME)])


def moved(values: Floats, pressures: Floats, moments: list[float]) -> float | None:
    """Return when a body moved that is not seen for a second, by the law fitted to what it reads."""
    noise = np.random.default_rng(0).normal(0.0, NOISE, len(TIME))
    inputs = Predictors.of(TIME, pressures).subset(np.flatnonzero(SEEN))
    seen = (values + noise)[SEEN, None]
    scaled = (seen - np.median(seen)) / seen.std()
    weights = np.ones(len(seen))
    covariance_inverse = precision(inputs, weights, fit_variances(inputs, scaled, weights))
    return relocation(inputs.time, covariance_inverse, scaled, np.array(moments), LEAST)


def test_an_offset_from_a_loss_on_is_found_at_its_end() -> None:
    values = SWEEPS @ [1.0, 0.5]
    assert moved(values + OFFSET * (TIME > LOST), SWEEPS, [10.0, LOST, 50.0]) == pytest.approx(LOST)


def test_a_body_found_where_it_was_is_not_relocated() -> None:
    assert moved(SWEEPS @ [1.0, 0.5], SWEEPS, [LOST]) is None


def test_a_loss_after_which_nothing_was_read_shows_nothing() -> None:
    assert moved(SWEEPS @ [1.0, 0.5] + OFFSET * (TIME > LOST), SWEEPS, [float(TIME[-1])]) is None


@pytest.mark.parametrize("seed", range(6))
def test_chambers_that_push_on_each_other_are_no_offset(seed: int) -> None:
    """Held pressures, and a body lost at a change of them: their product moves it after that."""
    held = np.random.default_rng(seed).uniform(0.0, 1.0, (12, 2))
    pressures = held[(TIME // 5.0).astype(int)]
    values = pressures @ [1.0, 0.5] + 1.5 * pressures[:, 0] * pressures[:, 1]
    assert moved(values, pressures, [LOST]) is None


def test_readings_that_go_on_after_a_loss_show_no_offset() -> None:
    """They move within five seconds, as a smooth law may: nothing jumps where the body was lost."""
    ageing = np.abs(TIME[:, None] - TIME[None, :])
    law = 1.0 + 0.5 * np.exp(-0.5 * (ageing / 5.0) ** 2)
    covariance = law + 1e-4 * np.exp(-ageing / CORRELATION) + 1e-4 * np.eye(len(TIME))
    values = 0.5 * np.clip((TIME - LOST) / 2.5, -1.0, 1.0)
    assert relocation(TIME, np.linalg.inv(covariance), values[:, None], np.array([LOST]), LEAST) is None
