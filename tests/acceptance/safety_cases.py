"""What every fault of every device must lead to."""

from collections.abc import Mapping
from enum import StrEnum

from softarm.daemon.safety.modes import Mode


class Expectation(StrEnum):
    """Where a fault leaves the arm."""

    VENTS = "vents"
    CARRIES_ON = "carries on"
    EITHER = "either"


FAST_S = 0.2
SLOW_S = 2.2
"""A pressure that is not reached counts after 1.5 s and 0.2 s more; then the arm vents."""

CLOSE_S = 0.02
"""So close to its deadline a pose may or may not be found late: the loop looks once a tick."""

VALVE_FAULTS = frozenset(
    {
        "node_down",
        "freeze",
        "drop_after_request",
        "watchdog_fired",
        "second_master",
        "valve_fault",
        "supply_missing",
    }
)
"""Faults of a valve terminal that end every pressurised mode: outputs unknown, lost, or not ours."""

SILENT_FAULTS = frozenset(
    {("festo_mpa", "stuck_valve"), ("festo_vtem", "stuck_valve"), ("festo_vtem", "supply_missing")}
)
"""The terminal does not report them. They show only where a pressure should change and does not: on this rig
where set-points are played."""

PLAYING = frozenset({Mode.ARMED, Mode.EXPERIMENT})

BLINDING_FAULTS = frozenset(
    {
        "no_more_data",
        "shutdown",
        "silence",
        "body_lost",
        "all_lost",
        "nan_body",
        "frozen_preview",
    }
)
"""Faults of the motion capture that take a needed pose away for good."""

BLIND_MODES = frozenset({Mode.TEACH, Mode.HOLDING, Mode.EXPERIMENT})

STRIKE: Mapping[str, Mapping[str, object]] = {"stuck_valve": {"channel": 3}, "valve_fault": {}}
"""Parameters of faults whose defaults would not show on this bench."""


def expected(
    kind: str, fault: str, mode: Mode, away_s: float, deadline_s: float
) -> tuple[Expectation, float]:
    """State where a fault must leave the arm, and how soon it is vented.

    A mode that follows the pose ends when a needed pose was away for longer than its deadline, whatever took
    it away; a connection that is back sooner ends nothing. Within two ticks of the deadline either is right.

    Args:
        kind: Kind of the device.
        fault: Name of the fault.
        mode: Mode in which it strikes.
        away_s: Longest time for which a needed pose was away, from the drivers' readings [s].
        deadline_s: Time after which a pose counts as lost [s].

    Returns:
        The outcome, and the time until the terminal holds zeros [s].
    """
    if (kind, fault) in SILENT_FAULTS:
        if mode in PLAYING:
            return Expectation.VENTS, SLOW_S
        # The pressures that hold the pose may lie above or below what the supply still reaches.
        if fault == "supply_missing":
            return Expectation.EITHER, SLOW_S
        return Expectation.CARRIES_ON, FAST_S
    if kind.startswith("festo") and fault in VALVE_FAULTS:
        return Expectation.VENTS, FAST_S
    if kind == "qualisys" and mode in BLIND_MODES:
        if fault in BLINDING_FAULTS or away_s > deadline_s + CLOSE_S:
            return Expectation.VENTS, FAST_S
        if away_s > deadline_s:
            return Expectation.EITHER, FAST_S
    return Expectation.CARRIES_ON, FAST_S
