"""Every kind of device at once under random faults, on real sockets and terminals, against the truth."""

import pytest

from acceptance import fault_run


@pytest.mark.timeout(300)
def test_twenty_seconds_of_random_faults():
    result = fault_run.run(20.0, seed=1, speed=40.0)
    assert [line for outcome in result.outcomes.values() for line in outcome.examples] == []
    assert {name: dict(o.unnoticed) for name, o in result.outcomes.items() if o.unnoticed} == {}
    assert {name: o.unrecovered for name, o in result.outcomes.items() if o.unrecovered} == {}
    assert (result.leaked, result.stray) == ([], [])
    assert result.sound
    assert sum(outcome.faults for outcome in result.outcomes.values()) > 40
    assert all(outcome.checked > 50 for outcome in result.outcomes.values())
