"""What every fault of every device must lead to."""

from collections.abc import Mapping
from enum import StrEnum

from service.safety.modes import PRESSURISED, Mode


class Outcome(StrEnum):
    """Where a fault leaves the arm."""

    VENTS = "vents"
    CARRIES_ON = "carries on"


FAST_S = 0.2
SLOW_S = 2.2
"""A pressure that is not reached counts after 1.5 s and 0.2 s more; then the arm vents."""

VALVE_FAULTS = frozenset(
    {
        "node_down",
        "freeze",
        "drop_after_request",
        "late_reply",
        "watchdog_fired",
        "second_master",
        "valve_fault",
        "supply_missing",
        "wrong_transaction",
        "wrong_protocol",
        "garbage",
    }
)
"""Faults of a valve terminal that end every pressurised mode: outputs unknown, lost, or not ours."""

SLOW_FAULTS = frozenset({"stuck_valve"})
"""They show only in a pressure that is not reached."""

BLINDING_FAULTS = frozenset(
    {
        "no_more_data",
        "settings_changed",
        "shutdown",
        "reset_connection",
        "silence",
        "zero_size",
        "huge_size",
        "body_lost",
        "all_lost",
        "nan_body",
        "restart",
        "frozen_preview",
    }
)
"""Faults of the motion capture that take away a needed pose for longer than its deadline."""

BLIND_MODES = frozenset({Mode.TEACH, Mode.HOLDING, Mode.EXPERIMENT})

STRIKE: Mapping[str, Mapping[str, object]] = {"stuck_valve": {"channel": 3}, "valve_fault": {}}
"""Parameters of faults whose defaults would not show on this bench."""


def expected(kind: str, fault: str, mode: Mode) -> tuple[Outcome, float]:
    """Say where a fault must leave the arm, and how soon it is vented.

    Args:
        kind: Kind of the device.
        fault: Name of the fault.
        mode: Mode in which it strikes.

    Returns:
        The outcome, and the time until the terminal holds zeros [s].
    """
    if mode not in PRESSURISED:
        return Outcome.CARRIES_ON, FAST_S
    if kind.startswith("festo") and fault in VALVE_FAULTS:
        return Outcome.VENTS, FAST_S
    if kind.startswith("festo") and fault in SLOW_FAULTS:
        return Outcome.VENTS, SLOW_S
    if kind == "qualisys" and fault in BLINDING_FAULTS and mode in BLIND_MODES:
        return Outcome.VENTS, FAST_S
    return Outcome.CARRIES_ON, FAST_S
