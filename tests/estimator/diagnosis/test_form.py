"""What a model of any arm may get wrong, as columns that nominal recordings teach."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from softarm.estimator.calibration.layout import CROSSTALK_SPREAD
from softarm.estimator.diagnosis.form import crosstalk, form_columns

OWNERS = (0, 0, 0, 1, 1, 1)
SAMPLES, ROWS = 150, 6


@pytest.fixture
def stage() -> Any:
    rng = np.random.default_rng(7)
    return SimpleNamespace(
        world=SimpleNamespace(chamber_segment=OWNERS, segments=("upper", "lower")),
        session=SimpleNamespace(
            pressures=rng.uniform(0.0, 5e4, (SAMPLES, 6)), clock=0.1 * np.arange(SAMPLES)
        ),
        input_jacobian=1e-5 * rng.normal(size=(SAMPLES, ROWS, 9)),
        by_eigenstrain=rng.normal(size=(SAMPLES, ROWS, 8)),
        arm=SimpleNamespace(baseline=SimpleNamespace(strains=rng.normal(size=(SAMPLES, 2, 4)))),
        reading_rows=rng.normal(size=(SAMPLES, ROWS)),
        residual=rng.normal(size=(SAMPLES, ROWS)),
    )


def test_a_share_of_each_pressure_acts_in_every_chamber_of_another_segment(stage: Any) -> None:
    rng = np.random.default_rng(8)
    shares = rng.normal(0.0, CROSSTALK_SPREAD, (6, 6))
    shares[np.equal.outer(OWNERS, OWNERS)] = 0.0
    pushed = np.einsum("trj,jk,tk->tr", stage.input_jacobian[..., :6], shares, stage.session.pressures)
    columns = form_columns(cast("Any", stage))
    spanned = columns.reshape(-1, columns.shape[-1])
    left = pushed.ravel() - spanned @ np.linalg.lstsq(spanned, pushed.ravel(), rcond=None)[0]
    assert len(crosstalk(stage)) == 2 * 3 * 3
    assert np.abs(left).max() < 1e-6 * np.abs(pushed).max()


def test_what_the_neighbours_of_one_segment_do_is_no_cross_talk(stage: Any) -> None:
    stage.session.pressures[:, 3:] = 0.0
    moved = [bool(column.any()) for column in crosstalk(stage)]
    assert sum(moved) == 3 * 3
    stage.world.chamber_segment = (0,) * 6
    assert crosstalk(stage) == []
