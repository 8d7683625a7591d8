"""Every fault of valves and motion capture, and some of the others, in a mode each: where is the arm left?"""

import pytest

from acceptance.safety_cases import Expectation
from acceptance.safety_run import BENCHES, MODES, parts, quick, run
from softarm_client.modes import Mode

pytestmark = pytest.mark.timeout(400)  # the real estimator solves all the while


BOTH = {Expectation.VENTS, Expectation.CARRIES_ON}
OUTCOMES = dict.fromkeys(MODES, BOTH) | {Mode.TEACH: {Expectation.CARRIES_ON}}


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.value)
def test_every_fault_leaves_the_arm_where_it_must_be_and_says_why(mode):
    (part,) = parts(BENCHES[:1], [mode])
    cases = run(part, quick)
    assert [case for case in cases if not case.right] == []
    assert len(cases) > 8
    assert {case.mode for case in cases} == {mode}
    assert {case.outcome for case in cases} == OUTCOMES[mode]
    assert all(case.said for case in cases if case.outcome is Expectation.VENTS)


def test_a_slot_error_is_kept_until_the_operator_clears_it():
    (part,) = [part for part in parts(modes=[Mode.HOLDING]) if "festo_vtem" in part.struck.values()]
    (case,) = run(part, lambda kind, fault, mode: fault == "valve_fault")
    assert case.right
    assert case.outcome is Expectation.VENTS
