"""What the safety benchmark makes of a fault that nothing provoked, in the events of a running rig."""

import pytest

from acceptance.safety_processes import LiveArm, ProcessEvent, struck
from softarm.common.errors import WorkFailedError
from softarm_client.messages import Event, Stamp
from softarm_client.modes import Mode

STAMP = Stamp(sequence=1, monotonic_ns=0, unix_ns=0, source="fake")


class Arm(LiveArm):
    def __init__(self):
        super().__init__(None, None, None)
        self.cleared = False

    def to_idle(self):
        self.cleared = True

    def fault(self, times):
        for _ in range(times):
            text = "ARMED -> FAULTED: valves: lost"
            self.watch(Event(stamp=STAMP, kind="mode", where="arm", text=text))


@pytest.mark.parametrize(
    ("faults", "provokes", "right"), [(0, 0, True), (1, 1, True), (1, 0, False), (2, 1, False)]
)
def test_a_fault_that_the_event_did_not_provoke_is_counted_and_wrong(faults, provokes, right):
    def strike(arm):
        arm.fault(faults)
        return ProcessEvent("a strike", Mode.ARMED, 0.1, 0.2, "", True, provokes)

    arm = Arm()
    arm.fault(3)  # those of the strike before
    event = struck(arm, strike)
    assert event.right is right
    assert event.row()["spurious_faults"] == faults - provokes


def test_a_rig_that_does_not_get_where_it_must_is_wrong_and_the_next_event_still_runs():
    def strike(arm):
        raise WorkFailedError("the arm is FAULTED: valves: lost")

    arm = Arm()
    event = struck(arm, strike)
    assert not event.right
    assert "valves: lost" in event.said
    assert arm.cleared
