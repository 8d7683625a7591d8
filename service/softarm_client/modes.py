"""The modes of the service, as its messages name them."""

from enum import StrEnum


class Mode(StrEnum):
    """What the service is doing with the arm."""

    STARTING = "STARTING"
    IDLE = "IDLE"
    ARMED = "ARMED"
    TEACH = "TEACH"
    HOLDING = "HOLDING"
    EXPERIMENT = "EXPERIMENT"
    FAULTED = "FAULTED"
    STOPPING = "STOPPING"


PRESSURISED = frozenset({Mode.ARMED, Mode.TEACH, Mode.HOLDING, Mode.EXPERIMENT})
"""Modes in which the valves may hold pressure; in every other one they are vented."""
