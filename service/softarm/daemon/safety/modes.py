"""The modes of the service and the one table of transitions between them."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

from softarm_client.modes import PRESSURISED as PRESSURISED
from softarm_client.modes import Mode as Mode

logger = logging.getLogger(__name__)
SERVICE = "service"
"""Originator of a change of mode that no client requested."""


class Trigger(StrEnum):
    """What moves the service from one mode to another."""

    READY = "ready"
    ARM = "arm"
    DISARM = "disarm"
    TEACH = "teach"
    HOLD = "hold"
    RELEASE = "release"
    EXPERIMENT_BEGIN = "experiment_begin"
    EXPERIMENT_END = "experiment_end"
    LEASE_LOST = "lease_lost"
    FAULT = "fault"
    CLEAR = "clear"
    SHUT_DOWN = "shut_down"


TRANSITIONS = MappingProxyType(
    {
        (Mode.STARTING, Trigger.READY): Mode.IDLE,
        (Mode.FAULTED, Trigger.READY): Mode.FAULTED,
        (Mode.IDLE, Trigger.ARM): Mode.ARMED,
        (Mode.ARMED, Trigger.TEACH): Mode.TEACH,
        (Mode.HOLDING, Trigger.TEACH): Mode.TEACH,
        (Mode.ARMED, Trigger.HOLD): Mode.HOLDING,
        (Mode.TEACH, Trigger.HOLD): Mode.HOLDING,
        (Mode.HOLDING, Trigger.HOLD): Mode.HOLDING,
        (Mode.TEACH, Trigger.RELEASE): Mode.ARMED,
        (Mode.HOLDING, Trigger.RELEASE): Mode.ARMED,
        (Mode.ARMED, Trigger.EXPERIMENT_BEGIN): Mode.EXPERIMENT,
        (Mode.EXPERIMENT, Trigger.EXPERIMENT_END): Mode.ARMED,
        (Mode.FAULTED, Trigger.CLEAR): Mode.IDLE,
        # Valves that keep an error while nothing is armed are acknowledged by the same command.
        (Mode.IDLE, Trigger.CLEAR): Mode.IDLE,
    }
    | {(mode, Trigger.DISARM): Mode.IDLE for mode in Mode if mode in PRESSURISED}
    | {(mode, Trigger.LEASE_LOST): Mode.IDLE for mode in Mode if mode in PRESSURISED}
    # Also in FAULTED: a stop vents again, whatever the mode.
    | {(mode, Trigger.FAULT): Mode.FAULTED for mode in Mode if mode is not Mode.STOPPING}
    | {(mode, Trigger.SHUT_DOWN): Mode.STOPPING for mode in Mode}
)
"""Every transition once the service is ready; what the table does not name is refused."""
BEFORE_READY = MappingProxyType({(Mode.FAULTED, Trigger.CLEAR): Mode.STARTING})
"""Transitions that lead elsewhere until ``ready`` has come."""


class TransitionRefusedError(Exception):
    """A trigger that the present mode does not allow."""

    def __init__(self, mode: Mode, trigger: Trigger) -> None:
        allowed = ", ".join(sorted(m for m, e in TRANSITIONS if e is trigger)) or "no mode"
        super().__init__(f"{trigger} is refused in {mode}; it is allowed in {allowed}")
        self.mode = mode
        self.trigger = trigger


@dataclass(frozen=True)
class Transition:
    """One change of mode.

    Args:
        before: The mode before.
        after: The mode that was entered.
        trigger: What caused it.
        cause: The reason in words.
        by: The client that requested it, or ``service``.
    """

    before: Mode
    after: Mode
    trigger: Trigger
    cause: str
    by: str = SERVICE


class ModeMachine:
    """The mode, its one writer, and the latched cause of a fault.

    Args:
        observer: Called after every transition, whoever requested it.
    """

    def __init__(self, observer: Callable[[Transition], None] = lambda _: None) -> None:
        self._observer = observer
        self._mode = Mode.STARTING
        self._fault_cause: str | None = None
        self._ready = False
        self._changes = 0

    @property
    def mode(self) -> Mode:
        """The present mode."""
        return self._mode

    @property
    def changes(self) -> int:
        """How many transitions there were: a command that waited sees whether there was one meanwhile."""
        return self._changes

    @property
    def fault_cause(self) -> str | None:
        """The first cause of the latched fault, kept until it is cleared."""
        return self._fault_cause

    def allows(self, trigger: Trigger) -> bool:
        """Return whether a trigger would be accepted now."""
        return (self._mode, trigger) in TRANSITIONS

    def target(self, trigger: Trigger) -> Mode:
        """Return the mode that a trigger leads to.

        Raises:
            TransitionRefusedError: The present mode does not allow the trigger.
        """
        if not self.allows(trigger):
            raise TransitionRefusedError(self._mode, trigger)
        after = TRANSITIONS[self._mode, trigger]
        return after if self._ready else BEFORE_READY.get((self._mode, trigger), after)

    def fire(self, trigger: Trigger, cause: str, by: str = SERVICE) -> Transition:
        """Apply a trigger and report the change to the observer.

        Args:
            trigger: What happened.
            cause: Why, in words; the first cause of a fault is latched.
            by: The client that requested it, or ``service``.

        Returns:
            The change of mode.

        Raises:
            TransitionRefusedError: The present mode does not allow the trigger.
        """
        before, after = self._mode, self.target(trigger)
        # Later faults are often consequences: vented valves no longer follow, the pose is lost.
        if trigger is Trigger.FAULT and before is not Mode.FAULTED:
            self._fault_cause = cause
        elif trigger is Trigger.CLEAR:
            self._fault_cause = None
        self._ready |= trigger is Trigger.READY
        self._mode = after
        self._changes += 1
        transition = Transition(before, after, trigger, cause, by)
        try:
            self._observer(transition)
        except Exception:  # a report that fails must neither undo the change nor end the caller
            logger.exception("%s -> %s could not be reported", before, after)
        return transition
