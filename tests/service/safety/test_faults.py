"""Every fault of valves and motion capture, and some of the others, in a mode each: where is the arm left?"""

import pytest

from acceptance.safety_cases import Expectation
from acceptance.safety_run import BENCHES, parts, quick, run
from softarm_client.modes import Mode

PRESSED = (Mode.ARMED, Mode.TEACH, Mode.HOLDING, Mode.EXPERIMENT)


pytestmark = pytest.mark.timeout(400)  # the real estimator solves all the while


@pytest.fixture(scope="module")
def cases():
    return [case for part in parts(BENCHES[:1], PRESSED) for case in run(part, quick)]


def test_every_fault_leaves_the_arm_where_it_must_be(cases):
    assert [case for case in cases if not case.right] == []


def test_the_matrix_is_not_empty(cases):
    assert len(cases) > 40
    assert {case.mode for case in cases} == {Mode.ARMED, Mode.TEACH, Mode.HOLDING, Mode.EXPERIMENT}
    assert {case.outcome for case in cases} == {Expectation.VENTS, Expectation.CARRIES_ON}


def test_a_slot_error_is_kept_until_the_operator_clears_it():
    (part,) = [part for part in parts(modes=[Mode.HOLDING]) if "festo_vtem" in part.struck.values()]
    (case,) = run(part, lambda kind, fault, mode: fault == "valve_fault")
    assert case.right
    assert case.outcome is Expectation.VENTS


def test_what_ends_a_mode_is_said(cases):
    assert all(case.said for case in cases if case.outcome is Expectation.VENTS)
