"""What the live tests share: looking at the fakes, and an arm under pressure."""

import contextlib
import time
from collections import deque

import numpy as np

from softarm.experiments.rig_control import ramp_pressures

PATIENCE_S = 20.0
"""For what is waited for, not timed."""
VENTED_MBAR = [0] * 6
STILL_M = 1.5e-3
"""A held pose moves by a third of this from look to look, as estimates do."""
SWING_S = 1.0
"""Two periods of the arm's slowest vibration: two looks alone could meet it in the same phase."""
LOOKS = 8
NEAR_PA = 8e3
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
    return client.states().wait_for(lambda s: s.mode == mode, timeout)


@contextlib.contextmanager
def collecting(stream):
    found = []
    with stream.subscribe(found.append):
        yield found


@contextlib.contextmanager
def pressurised(client, mode="ARMED", pressure=20e3):
    """The arm under pressure in a mode; afterwards IDLE. A fault on the way there fails the test."""
    with client.lease():
        _bring_to(client, mode, pressure)
        yield
        if client.state().mode not in ("IDLE", "FAULTED"):
            client.disarm()


def _bring_to(client, mode, pressure):
    goal = [pressure, *[0.0] * 5]
    client.arm()
    if mode == "HOLDING":  # the pose of an arm that swings is held by other pressures
        ramp_pressures(client, [0.0] * 6, goal, 0.5 * SWING_S)
    client.pressures.set(goal, lifetime_s=10.0)
    # Teaching begins where the arm is bent: the pressures that hold it straight are none.
    _until(client, lambda s: max(p or 0.0 for p in s.measured_pa) > 0.9 * pressure)
    if mode == "HOLDING":
        _at_rest(client)
    if mode in ("TEACH", "HOLDING"):
        client.teach.start()
        _until(client, lambda s: s.teach_pressures_pa is not None)
    if mode == "HOLDING":
        client.teach.hold(ramp_s=0.2)
    _until(client, lambda s: s.mode == mode and max(p or 0.0 for p in s.measured_pa) > 0.5 * pressure)


def _at_rest(client):
    return _once_at_rest(client, client.state, lambda state: np.array(state.sections[-1].position_m))


def _once_at_rest(client, look, positions):
    """Return what a look shows once the positions have hardly moved through whole periods of vibration."""
    deadline, looks = time.monotonic() + PATIENCE_S, deque(maxlen=1 + LOOKS)
    while True:
        looks.append(look())
        if len(looks) > LOOKS and np.ptp([positions(seen) for seen in looks], axis=0).max() < STILL_M:
            return looks[-1]
        assert time.monotonic() < deadline, "the arm does not come to rest"
        later(client, SWING_S / LOOKS)


def _until(client, accept):
    state = client.states().wait_for(lambda s: s.mode == "FAULTED" or accept(s), PATIENCE_S)
    assert state.mode != "FAULTED", f"a fault that nothing provoked: {state.fault_cause}"


def cleared(client, timeout=PATIENCE_S):
    """Clear the latched fault, once, when no finding of the valves stands any more.

    A loop that stood still finds out only some ticks later that the valves were silent meanwhile.
    """
    later(client, 0.5)
    client.states().wait_for(lambda s: not any(f.code.startswith("valve") for f in s.findings), timeout)
    client.clear()
    return wait_for_mode(client, "IDLE")


def later(client, seconds):
    """Wait until the service has published a state so much later; its loop runs all the while."""
    since = client.state().stamp.monotonic_ns
    return client.states().wait_for(
        lambda s: (s.stamp.monotonic_ns - since) * 1e-9 > seconds, seconds + PATIENCE_S
    )


def still(client, fakes):
    """Return the true pose of the arm once it no longer moves."""
    return _once_at_rest(client, lambda: pose(fakes), lambda truth: truth[0])


def settled(client):
    """Wait until a hold has ended its ramp and the valves follow."""
    later(client, 2.0)
    return client.states().wait_for(lambda s: s.mode == "HOLDING" and _follows(s), PATIENCE_S)


def _follows(state):
    pairs = zip(state.asked_pa, state.measured_pa, strict=True)
    return all(measured is not None and abs(asked - measured) < NEAR_PA for asked, measured in pairs)
