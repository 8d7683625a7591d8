"""Rows of the objectives: their weights, costs and gradients are those of the sum of squares."""

import numpy as np
import pytest

from softarm.estimator.inverse.objectives import Iterate, Objective, PressureReadings, Prior, SensorObjective
from softarm.estimator.model import Frames
from softarm.estimator.rotations import exp
from softarm.estimator.sensing import Orientation, SensorSuite

RANDOM = np.random.default_rng(3)
MOTION = RANDOM.normal(size=(12, 8))
DRIFT = 1e-3 * RANDOM.normal(size=12)
FRAMES = Frames(RANDOM.normal(size=(2, 3)), exp(RANDOM.normal(size=(2, 3))))
SUITE = SensorSuite((Orientation("middle", 0, 0.01), Orientation("end", 1, 0.02)))
HALF = RANDOM.normal(size=(8, 8))
AT = Iterate(FRAMES, RANDOM.normal(size=8), 6, lambda rows: (rows @ DRIFT, rows @ MOTION))
PRESSURES = np.array([1.0, np.nan, 3.0, 4.0, np.nan, 6.0])
OBJECTIVES = (
    SensorObjective(SUITE, SUITE.predict(Frames(FRAMES.positions, FRAMES.rotations @ exp(np.full(3, 0.1))))),
    PressureReadings(PRESSURES, np.full(6, 0.3)),
    Prior(RANDOM.normal(size=8), HALF @ HALF.T),
)


@pytest.mark.parametrize("objective", OBJECTIVES, ids=["sensors", "pressures", "prior"])
def test_weights_follow_from_the_information(objective: Objective) -> None:
    change = 0.01 * RANDOM.normal(size=8)
    before = objective.rows(AT)
    for rows in (before, before.moved(change)):
        weighted = rows.jacobian.T @ rows.information
        np.testing.assert_allclose(rows.weighted, weighted, atol=1e-9)
        np.testing.assert_allclose(rows.normal, weighted @ rows.jacobian, atol=1e-9)
        np.testing.assert_allclose(rows.gradient, weighted @ rows.innovation, atol=1e-9)
        assert rows.cost == pytest.approx(rows.innovation @ rows.information @ rows.innovation)
    np.testing.assert_allclose(
        before.moved(change).innovation, before.innovation - before.jacobian @ change, atol=1e-12
    )


def test_a_drift_is_taken_out_of_the_innovation() -> None:
    still = Iterate(FRAMES, AT.vector, 6, lambda rows: (np.zeros(len(rows)), rows @ MOTION))
    twists = SUITE.observe(FRAMES, OBJECTIVES[0].readings).twists
    drifting = OBJECTIVES[0].rows(AT).innovation
    np.testing.assert_allclose(drifting, OBJECTIVES[0].rows(still).innovation - twists @ DRIFT, atol=1e-12)


def test_pressures_that_are_lost_have_no_rows() -> None:
    np.testing.assert_array_equal(OBJECTIVES[1].rows(AT).members, [0, 2, 3, 5])
