"""What the tables of a calibration say beneath them."""

from types import SimpleNamespace
from typing import cast

import pytest

from softarm.analysis.calibration_tables import calibration_tables
from softarm.estimator.calibration.outcome import Calibrated


@pytest.mark.parametrize(
    ("lags", "fitted", "words"),
    [
        ((None, None), 1, "1 unknown fitted to 108 samples; converged."),
        ((0.033,), 22, "22 unknowns fitted to 108 samples; converged; motion lags the pressures by 33 ms."),
        ((0.033, None), 22, "motion lags the pressures by 33 ms, unknown."),
    ],
)
def test_a_lag_that_no_run_shows_is_left_out(lags: tuple[float | None, ...], fitted: int, words: str) -> None:
    check = SimpleNamespace(training={}, line={}, line_parameters=0)
    outcome = SimpleNamespace(
        identified=(), lags=lags, mirrored={}, fitted=fitted, nodes=108, status="converged", check=check
    )
    first, _ = calibration_tables(cast("Calibrated", outcome))
    assert words in first.notes[0]
