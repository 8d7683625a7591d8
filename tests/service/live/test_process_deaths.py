"""The death of the service's own processes; after these the rig is done for, so they come last."""

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from softarm.recordings import load_recording
from softarm_client import Arm
from tests.service.live.helpers import (
    VENTED_MBAR,
    VENTED_S,
    cleared,
    later,
    pressurised,
    seconds_until_vented,
    setpoints,
    wait_for_mode,
)

pytestmark = pytest.mark.timeout(240)


def test_killed_estimator_vents_a_held_pose(rig, client, fakes, provokes_a_fault):
    (estimator,) = children(rig.service.process.pid, "spawn_main")
    with pressurised(client, "HOLDING"):
        os.kill(estimator, signal.SIGKILL)
        assert seconds_until_vented(fakes) < VENTED_S
        assert "estimator" in wait_for_mode(client, "FAULTED").fault_cause


def children(parent, word):
    listed = subprocess.run(
        ["ps", "-ww", "--ppid", str(parent), "-o", "pid=,args="], capture_output=True, text=True, check=True
    ).stdout
    return [int(line.split()[0]) for line in listed.splitlines() if word in line]


def test_killed_service_leaves_the_arm_vented_and_its_recording_readable(rig, client, fakes):
    if client.state().mode == "FAULTED":
        cleared(client)
    with Arm(rig.settings.arm, rig.settings.endpoint, name="last") as last, last.lease():
        path = Path(last.recordings.start("torn").path)
        later(last, 2.5)  # the file is flushed every second
        last.arm()
        last.pressures.set([2e4] * 6, lifetime_s=10.0)
        begin = time.monotonic()
        while setpoints(fakes) == VENTED_MBAR:
            assert time.monotonic() - begin < 2.0
        rig.service.process.kill()
        assert seconds_until_vented(fakes) < VENTED_S
    torn = load_recording(path.with_name(path.name + ".part"))
    assert torn.time[-1] - torn.time[0] > 0.8
