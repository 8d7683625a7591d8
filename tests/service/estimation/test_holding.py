"""The pressures that hold a pose: the linear answer, and what the search now and then adds to it."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from estimator.inverse import Compensation
from estimator.sensing import ActuationMap
from service.estimation import holding
from service.estimation.holding import SEARCH_EVERY, Arm, Holding

LINEAR, ADDED = 2e3, 300.0


@dataclass
class Searches:
    """Stands in for the search; it counts, and fails where it should."""

    fail: bool = False
    starts: list = field(default_factory=list)

    def __call__(self, model, estimate, suite, limits, tare, first, start, tolerances):
        self.starts.append(start)
        if self.fail:
            return first, None
        found = SimpleNamespace(state="reached", inputs="there")
        return Compensation(first.change + ADDED, True, "The pose can be reached."), found


@pytest.fixture
def searches(monkeypatch):
    made = Searches()
    first = Compensation(np.full(6, LINEAR), True, "The pose can be reached.")
    monkeypatch.setattr(holding, "replace_loads", lambda *_: first)
    monkeypatch.setattr(holding, "settle", made)
    return made


def pressures(held, converged=True, times=1):
    estimate = SimpleNamespace(
        converged=converged, motion=np.zeros((18, 10)), inputs=SimpleNamespace(pressures=np.full(6, 1e4))
    )
    return [held.answer(None, estimate, np.zeros(4), None) for _ in range(times)]


@pytest.fixture
def held():
    actuation = ActuationMap(np.ones(6), np.zeros(6), 1.0)
    return Holding(Arm(None, actuation, np.full(6, 65e3), lambda acting: acting / 0.8))


def test_the_search_runs_now_and_then_and_what_it_added_stays(searches, held):
    answers = pressures(held, times=SEARCH_EVERY + 1)
    assert searches.starts == [None, ("reached", "there")]
    for answer in answers:
        np.testing.assert_allclose(answer.pressures, (1e4 + LINEAR + ADDED) / 0.8)


def test_after_a_search_that_failed_the_linear_answer_stands(searches, held):
    searches.fail = True
    (answer,) = pressures(held)
    np.testing.assert_allclose(answer.pressures, (1e4 + LINEAR) / 0.8)


def test_an_estimate_that_failed_begins_the_search_anew(searches, held):
    pressures(held)
    assert not pressures(held, converged=False)[0].known
    pressures(held)
    assert searches.starts == [None, None]
