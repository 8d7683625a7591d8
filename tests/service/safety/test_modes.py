from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from softarm.daemon.safety.modes import (
    PRESSURISED,
    TRANSITIONS,
    Mode,
    ModeMachine,
    TransitionRefusedError,
    Trigger,
)


class Operation(RuleBasedStateMachine):
    """Any sequence of events keeps the promises of the table."""

    def __init__(self):
        super().__init__()
        self.machine = ModeMachine()
        self.armed_since_idle = self.ready = False
        self.first_cause = None

    @rule(event=st.sampled_from(Trigger), cause=st.text(max_size=5))
    def fire(self, event, cause):
        before = self.machine.mode
        if (before, event) not in TRANSITIONS:
            assert not self.machine.allows(event)
            try:
                self.machine.fire(event, cause)
            except TransitionRefusedError:
                assert self.machine.mode is before
                return
            raise AssertionError(f"{event} was accepted in {before}")
        transition = self.machine.fire(event, cause)
        assert (transition.before, transition.after) == (before, self.machine.mode)
        self.ready |= event is Trigger.READY
        if event is Trigger.ARM:
            self.armed_since_idle = True
        if self.machine.mode not in PRESSURISED:
            self.armed_since_idle = False
        if event is Trigger.FAULT and before is not Mode.FAULTED:
            self.first_cause = cause
        if event is Trigger.CLEAR:
            self.first_cause = None

    @invariant()
    def pressure_only_after_arm(self):
        if self.machine.mode in PRESSURISED:
            assert self.armed_since_idle

    @invariant()
    def idle_and_pressure_only_when_ready(self):
        assert self.ready or self.machine.mode in (Mode.STARTING, Mode.FAULTED, Mode.STOPPING)

    @invariant()
    def cause_is_latched(self):
        if self.machine.mode is Mode.FAULTED:
            assert self.machine.fault_cause == self.first_cause


TestOperation = Operation.TestCase


@given(st.sampled_from(Mode))
def test_fault_and_shut_down_always_leave_pressure(mode):
    assert TRANSITIONS[(mode, Trigger.SHUT_DOWN)] is Mode.STOPPING
    if mode is not Mode.STOPPING:
        assert TRANSITIONS[(mode, Trigger.FAULT)] is Mode.FAULTED


def test_only_arm_enters_pressure_from_a_vented_mode():
    entering = {
        (before, event)
        for (before, event), after in TRANSITIONS.items()
        if after in PRESSURISED and before not in PRESSURISED
    }
    assert entering == {(Mode.IDLE, Trigger.ARM)}


def test_nothing_leaves_stopping():
    assert {after for (before, _), after in TRANSITIONS.items() if before is Mode.STOPPING} == {Mode.STOPPING}


def test_every_mode_is_reachable():
    reached = {Mode.STARTING}
    for _ in Mode:
        reached |= {after for (before, _), after in TRANSITIONS.items() if before in reached}
    assert reached == set(Mode)
