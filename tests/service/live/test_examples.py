"""The two short programs of the client, against the fakes and the service as processes."""

import subprocess
import sys
from pathlib import Path

import pytest

from softarm_client import Arm

pytestmark = pytest.mark.timeout(240)  # the estimator compiles its kernels in a fresh checkout

EXAMPLES = Path(__file__).parents[3] / "examples"
HANDS = ([0.12, 0.0, 0.0], [0.0, 0.12, 0.0], [-0.1, 0.05, 0.0])


@pytest.fixture
def program(rig):
    """Start an example on the arm of the rig; it ends with the test."""
    started = []

    def start(name):
        command = [sys.executable, EXAMPLES / name, rig.settings.arm, rig.settings.endpoint]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        started.append(subprocess.Popen(command, text=True, **pipes))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


def test_ten_lines_print_the_force(client, fakes, program):
    fakes.ask("hand", section="tip", force_n=[0.3, 0.0, 0.0])
    printing = program("print_force.py")
    for line in printing.stdout:
        section, x, *_ = line.split()
        if section == "tip" and 0.2 < float(x) < 0.4:
            return
    pytest.fail(printing.stderr.read())


def test_three_poses_are_taught_and_replayed(client, rig, fakes, program):
    teaching = program("teach_and_replay.py")
    with Arm(rig.settings.arm, rig.settings.endpoint, name="watcher") as watcher:
        for force in HANDS:
            watcher.states().wait_for(lambda state: state.mode == "TEACH", 20.0)
            fakes.ask("hand", section="tip", force_n=force)
            watcher.states().wait_for(lambda state: state.teach_pressures_pa is not None, 20.0)
            print(file=teaching.stdin, flush=True)
            watcher.states().wait_for(lambda state: state.mode == "HOLDING", 20.0)
            fakes.ask("hand")
            print(file=teaching.stdin, flush=True)
        for _ in HANDS:
            watcher.states().wait_for(lambda state: state.mode == "HOLDING", 20.0)
            print(file=teaching.stdin, flush=True)
        out, errors = teaching.communicate(timeout=100)
        assert teaching.returncode == 0, errors
        assert out.count("within reach") == 3
        assert set(watcher.teach.poses()) >= {"one", "two", "three"}
