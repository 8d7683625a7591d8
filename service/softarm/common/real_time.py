"""Scheduling of what keeps real time: before all other programs, where that is permitted."""

import os
from contextlib import suppress

POLICY = os.SCHED_RR | os.SCHED_RESET_ON_FORK
"""Real-time, for one thread alone: what it starts later has the usual policy (sched(7))."""
LOWEST = 1
"""Threads of the kernel that are real-time come first."""


def raise_priority(pid: int = 0) -> None:
    """Schedule a thread before all that are not real-time, where that is permitted.

    Args:
        pid: The thread, by default the calling one; that of a process is its first.
    """
    with suppress(PermissionError):
        os.sched_setscheduler(pid, POLICY, os.sched_param(LOWEST))
