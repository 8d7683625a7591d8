"""The modes of the service and the one table of transitions between them."""

from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

from softarm.api.modes import Mode as Mode


class Event(StrEnum):
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
        (Mode.STARTING, Event.READY): Mode.IDLE,
        (Mode.IDLE, Event.ARM): Mode.ARMED,
        (Mode.ARMED, Event.TEACH): Mode.TEACH,
        (Mode.HOLDING, Event.TEACH): Mode.TEACH,
        (Mode.ARMED, Event.HOLD): Mode.HOLDING,
        (Mode.TEACH, Event.HOLD): Mode.HOLDING,
        (Mode.HOLDING, Event.HOLD): Mode.HOLDING,
        (Mode.TEACH, Event.RELEASE): Mode.ARMED,
        (Mode.HOLDING, Event.RELEASE): Mode.ARMED,
        (Mode.ARMED, Event.EXPERIMENT_BEGIN): Mode.EXPERIMENT,
        (Mode.EXPERIMENT, Event.EXPERIMENT_END): Mode.ARMED,
        (Mode.FAULTED, Event.CLEAR): Mode.IDLE,
        (Mode.IDLE, Event.CLEAR): Mode.IDLE,
    }
    | {(mode, Event.DISARM): Mode.IDLE for mode in Mode if mode in PRESSURISED}
    | {(mode, Event.LEASE_LOST): Mode.IDLE for mode in Mode if mode in PRESSURISED}
    | {(mode, Event.FAULT): Mode.FAULTED for mode in Mode if mode is not Mode.STOPPING}
    | {(mode, Event.SHUT_DOWN): Mode.STOPPING for mode in Mode}
)
"""Every transition there is; what the table does not name is refused."""


class TransitionRefusedError(Exception):
    """An event that the present mode does not allow.

    Args:
        mode: The present mode.
        event: The event refused.
    """

    def __init__(self, mode: Mode, event: Event) -> None:
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
    """

    before: Mode
    after: Mode
    event: Event
    cause: str


class ModeMachine:
    """The mode, its one writer, and the latched cause of a fault."""

    def __init__(self) -> None:
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

    def allows(self, event: Event) -> bool:
        """Tell whether an event would be accepted now."""
        return (self._mode, event) in TRANSITIONS

    def fire(self, event: Event, cause: str) -> Transition:
        """Apply an event.

        Args:
            event: What happened.
            cause: Why, in words; the first cause of a fault is latched.

        Returns:
            The change of mode.

        Raises:
            TransitionRefusedError: The present mode does not allow the event.
        """
        before = self._mode
        after = TRANSITIONS.get((before, event))
        if after is None:
            raise TransitionRefusedError(before, event)
        if event is Event.FAULT and before is not Mode.FAULTED:
            self._fault_cause = cause
        elif event is Event.CLEAR:
            self._fault_cause = None
        self._mode = after
        return Transition(before, after, event, cause)
