"""Going on after a hiccup: on fakes, whose machine may be busy, an experiment clears, arms and ramps anew."""

import threading
import time
from collections.abc import Callable, Sequence

from softarm.experiments.rig_control import ramp_pressures
from softarm_client import Arm
from softarm_client.errors import CommandRefusedError

PATIENCE_S = 20.0
PAUSE_S = 0.2
ATTEMPTS = 3


def until_allowed(ask: Callable[[], object]) -> None:
    """Ask for something until it is not refused: a cause may take a while to pass.

    Args:
        ask: Sends the commands.

    Raises:
        CommandRefusedError: ``PATIENCE_S`` of waiting did not help.
    """
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            ask()
        except CommandRefusedError:
            if time.monotonic() > deadline:
                raise
            threading.Event().wait(PAUSE_S)
        else:
            return


def arm_again(client: Arm) -> None:
    """Arm, first clearing a fault whose cause is gone.

    Args:
        client: The arm's client, with the lease.

    Raises:
        CommandRefusedError: It cannot be armed, and waiting did not help.
    """

    def arm() -> None:
        mode = client.state().mode
        if mode == "FAULTED":
            client.clear()
        if mode != "ARMED":
            client.arm()

    until_allowed(arm)


def lead(client: Arm, start: Sequence[float], goal: Sequence[float], duration_s: float) -> None:
    """Lead the pressures along a straight line; where a fault vents the arm, begin anew from zero.

    Args:
        client: The arm's client, with the lease.
        start: Pressures at the beginning [Pa].
        goal: Pressures at the end [Pa].
        duration_s: How long it takes.

    Raises:
        CommandRefusedError: Faults keep striking.
    """
    for left in reversed(range(ATTEMPTS)):
        try:
            ramp_pressures(client, start, goal, duration_s)
        except CommandRefusedError:
            if not left:
                raise
            arm_again(client)
            start = [0.0] * len(goal)
        else:
            return
