"""What the latency benchmark makes of the estimates that it heard."""

import numpy as np
import pytest

from softarm.bench.latency import STAGES, LatencyCase, Measured, row_of, stage_rows

CASE = LatencyCase("rod", 100.0, busy=False)


def measured(stages_ms: np.ndarray) -> Measured:
    return Measured(stages_ms.sum(axis=1), stages_ms, np.ones(3), 1.0, 1000, 2, 10.0)


def test_stages_show_which_of_them_makes_an_estimate_late() -> None:
    stages = np.tile([1.0, 0.5, 0.25], (200, 1))
    stages[:2, 1] = 20.0
    rows = {row["stage"]: row for row in stage_rows(CASE, measured(stages))}
    assert tuple(rows) == STAGES
    assert rows["service"]["median_ms"] == 0.5
    assert rows["service"]["among_slowest_ms"] == pytest.approx(20.0)
    assert rows["solve"]["among_slowest_ms"] == 1.0


def test_a_case_without_estimates_has_no_stages_and_does_not_pass() -> None:
    nothing = measured(np.zeros((0, 3)))
    assert stage_rows(CASE, nothing) == []
    assert row_of(CASE, nothing)["passes"] is False
