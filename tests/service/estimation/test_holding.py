"""The pressures that hold a pose are taken back through the specimen's physics."""

from types import SimpleNamespace

import numpy as np
import pytest

from softarm.daemon.estimation import holding
from softarm.daemon.estimation.holding import HoldSolver
from softarm.estimator.inverse import Compensation
from softarm.estimator.sensing import ActuationMap


@pytest.mark.parametrize("converged", [True, False])
def test_pressures_are_taken_back_through_the_physics(monkeypatch, converged):
    first = Compensation(np.full(6, 2e3), True, "The pose can be reached.")
    monkeypatch.setattr(holding, "replace_loads", lambda *_: first)
    arm = HoldSolver(
        None, ActuationMap(np.ones(6), np.zeros(6), 1.0), np.full(6, 65e3), lambda acting: acting / 0.8
    )
    inputs = SimpleNamespace(pressures=np.full(6, 1e4))
    estimate = SimpleNamespace(converged=converged, motion=np.zeros((18, 10)), inputs=inputs, residuals={})
    answer = arm.answer(estimate, np.zeros(4), None)
    assert answer.valid is converged
    np.testing.assert_allclose(answer.pressures, 1.2e4 / 0.8 if converged else 0.0)
