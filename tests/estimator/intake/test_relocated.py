"""Readings that keep an offset after a loss, on a synthetic recording: a linear reaction to one pressure."""

import numpy as np
import pytest

from softarm.estimator.intake.grid import Grid
from softarm.estimator.intake.relocated import relocation

STEP, LOST, OFFSET, NOISE = 0.1, 30.0, 5e-3, 2e-4
ALL = np.array([True])


def recorded(offset: float) -> Grid:
    """Return a body that follows a pressure, is lost for a second and found with an offset [m]."""
    rng = np.random.default_rng(0)
    time = np.arange(0.0, 60.0, STEP)
    pressure = 2e4 * (1.0 + np.sin(0.7 * time) * np.cos(0.11 * time))
    values = 1e-6 * pressure + offset * (time > LOST) + rng.normal(0.0, NOISE, len(time))
    values[(time > LOST - 1.0) & (time <= LOST)] = np.nan
    return Grid(time, STEP, pressure[:, None], values[:, None], np.array([0]), ("m",))


def test_an_offset_from_a_loss_on_is_found_at_its_end() -> None:
    moments = np.array([10.0, LOST, 50.0])
    assert relocation(recorded(OFFSET), ALL, moments, np.array([1e-3])) == pytest.approx(LOST)


def test_a_body_found_where_it_was_is_not_relocated() -> None:
    assert relocation(recorded(0.0), ALL, np.array([LOST]), np.array([1e-4])) is None


def test_a_loss_after_which_nothing_was_read_shows_nothing() -> None:
    grid = recorded(OFFSET)
    assert relocation(grid, ALL, np.array([grid.time[-1]]), np.array([1e-3])) is None
