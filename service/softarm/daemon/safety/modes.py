"""The modes of the service and the one table of transitions between them."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

from softarm.api.modes import Mode as Mode

logger = logging.getLogger(__name__)
SERVICE = "service"
"""Who changes the mode where no client asked for it."""


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


PRESSURISED = frozenset({Mode.ARMED, Mode.TEACH, Mode.HOLDING, Mode.EXPERIMENT})
"""Modes in which the valves may hold pressure; in every other one they are vented."""

TRANSITIONS = MappingProxyType(
    {
        (Mode.STARTING, Trigger.READY): Mode.IDLE,
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
        (Mode.IDLE, Trigger.CLEAR): Mode.IDLE,
    }
    | {(mode, Trigger.DISARM): Mode.IDLE for mode in Mode if mode in PRESSURISED}
    | {(mode, Trigger.LEASE_LOST): Mode.IDLE for mode in Mode if mode in PRESSURISED}
    | {(mode, Trigger.FAULT): Mode.FAULTED for mode in Mode if mode is not Mode.STOPPING}
    | {(mode, Trigger.SHUT_DOWN): Mode.STOPPING for mode in Mode}
)
"""Every transition there is; what the table does not name is refused."""


class TransitionRefusedError(Exception):
    """An event that the present mode does not allow.

    Args:
        mode: The present mode.
        event: The event refused.
    """

    def __init__(self, mode: Mode, event: Trigger) -> None:
        allowed = ", ".join(sorted(m for m, e in TRANSITIONS if e is event)) or "no mode"
        super().__init__(f"{event} is refused in {mode}; it is allowed in {allowed}")
        self.mode = mode
        self.event = event


@dataclass(frozen=True)
class Transition:
    """One change of mode.

    Args:
        before: The mode that was left.
        after: The mode that was entered.
        event: What caused it.
        cause: The reason in words.
        by: The client that asked for it, or ``service``.
    """

    before: Mode
    after: Mode
    event: Trigger
    cause: str
    by: str = SERVICE


class ModeMachine:
    """The mode, its one writer, and the latched cause of a fault.

    Args:
        observer: Called after every transition, whoever asked for it.
    """

    def __init__(self, observer: Callable[[Transition], None] = lambda _: None) -> None:
        self._observer = observer
        self._mode = Mode.STARTING
        self._fault_cause: str | None = None

    @property
    def mode(self) -> Mode:
        """The present mode."""
        return self._mode

    @property
    def fault_cause(self) -> str | None:
        """The first cause of the latched fault, kept until it is cleared."""
        return self._fault_cause

    def allows(self, event: Trigger) -> bool:
        """Tell whether an event would be accepted now."""
        return (self._mode, event) in TRANSITIONS

    def target(self, event: Trigger) -> Mode:
        """Return the mode that an event leads to.

        Raises:
            TransitionRefusedError: The present mode does not allow the event.
        """
        after = TRANSITIONS.get((self._mode, event))
        if after is None:
            raise TransitionRefusedError(self._mode, event)
        return after

    def fire(self, event: Trigger, cause: str, by: str = SERVICE) -> Transition:
        """Apply an event and report the change to the observer.

        Args:
            event: What happened.
            cause: Why, in words; the first cause of a fault is latched.
            by: The client that asked for it, or ``service``.

        Returns:
            The change of mode.

        Raises:
            TransitionRefusedError: The present mode does not allow the event.
        """
        before, after = self._mode, self.target(event)
        if event is Trigger.FAULT and before is not Mode.FAULTED:
            self._fault_cause = cause
        elif event is Trigger.CLEAR:
            self._fault_cause = None
        self._mode = after
        transition = Transition(before, after, event, cause, by)
        try:
            self._observer(transition)
        except Exception:  # a report that fails must neither undo the change nor end the caller
            logger.exception("%s -> %s could not be reported", before, after)
        return transition
