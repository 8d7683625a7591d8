"""What the live tests share: looking at the fakes, and an arm under pressure."""

import contextlib
import threading
import time

import numpy as np

from softarm.api.messages import State
from softarm.client.client import CommandRefusedError
from softarm.experiments.recovery import arm_again

PATIENCE_S = 20.0
"""For what is waited for, not timed."""
ATTEMPTS = 10
VENTED_MBAR = [0] * 6
VENTED_S = 0.3
"""The fakes' own clock holds 0.2 s in test_faults; asking them takes its time on a busy machine."""


def pose(fakes):
    truth = fakes.ask("truth")
    return np.array(truth["positions"]), np.array(truth["quaternions"])


def setpoints(fakes):
    return fakes.ask("truth")["setpoints_mbar"]["valves"]


def seconds_until_vented(fakes, within=2.0):
    begin = time.monotonic()
    while setpoints(fakes) != VENTED_MBAR:
        assert time.monotonic() - begin < within, "the valves hold pressure"
    return time.monotonic() - begin


def wait_for_mode(client, mode, timeout=PATIENCE_S):
    return client.wait_for("state", State, lambda s: s.mode == mode, timeout)


@contextlib.contextmanager
def collecting(client, stream):
    found = []
    with client.subscribe(stream, found.append):
        yield found


@contextlib.contextmanager
def pressurised(client, mode="ARMED", pressure=20e3):
    """The arm under pressure in a mode; afterwards IDLE. What a busy machine makes it vent for is cleared."""
    with client.lease():
        for _ in range(ATTEMPTS):
            with contextlib.suppress(CommandRefusedError):
                if _brought_to(client, mode, pressure):
                    break
            threading.Event().wait(0.5)
        else:
            raise AssertionError(f"never in {mode}: {client.state()}")
        yield
        if client.state().mode not in ("IDLE", "FAULTED"):
            client.command("disarm")


def _brought_to(client, mode, pressure):
    """Whether the arm came to be in the mode and under pressure before anything made it vent."""

    def until(accept):
        state = client.wait_for("state", State, lambda s: s.mode == "FAULTED" or accept(s), PATIENCE_S)
        return state.mode != "FAULTED"

    arm_again(client)
    client.command("set_pressures", pressures_pa=[pressure, *[0.0] * 5], lifetime_s=10.0)
    if mode in ("TEACH", "HOLDING"):
        client.command("teach/start")
        if not until(lambda s: s.teach_pressures_pa is not None):
            return False
    if mode == "HOLDING":
        client.command("teach/hold", ramp_s=0.2)
    return until(lambda s: s.mode == mode and max(p or 0.0 for p in s.measured_pa) > 0.5 * pressure)


def cleared(client, timeout=PATIENCE_S):
    """Clear the latched fault as soon as its cause is gone; nothing comes back by itself."""
    deadline = time.monotonic() + timeout
    while True:
        try:
            client.command("clear")
            return wait_for_mode(client, "IDLE")
        except CommandRefusedError:
            assert time.monotonic() < deadline
            threading.Event().wait(0.05)
            if client.state().mode == "IDLE":
                return client.state()
