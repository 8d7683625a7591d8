"""The live commands of docs/tutorial.md, run as written, print what the tutorial shows."""

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import pytest

from softarm_client import Arm
from tests.cli.tutorial import ROOT, Step, steps

pytestmark = pytest.mark.timeout(500)

DEMO, TEACH, RECORD = steps(1)
DESCRIBE, *OTHERS = steps(3)
FAKES, DOCTOR, SERVE, STATUS, *_, FORCE, SAVE, GOTO, _ = OTHERS
PORTS = (7447, 8080)
"""Of the service and of the operator page, by default."""
POSES = 3
PATIENCE_S = 60.0
TRIES = 100


def as_here(step: Step) -> list[str]:
    """Run a command of the tutorial in this environment: ``./run`` sets one up first."""
    first, *rest = step.command.split()
    return [sys.executable, "-m", "softarm", *rest] if first == "./run" else [sys.executable, *rest]


def taken(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def wait_for(line: str, stream: IO[str]) -> None:
    printed: list[str] = []
    for one in stream:
        if one.strip() == line or (line.endswith(" ...") and one.startswith(line.removesuffix("..."))):
            return
        printed.append(one)
    pytest.fail(f"the tutorial shows {line!r}, which was not printed:\n{''.join(printed[-10:])}")


def shows(step: Step, printed: str) -> bool:
    """Tell whether a command printed every line that is shown; ``...`` within a line stands for anything."""
    pieces = [piece for line in step.printed for piece in line.split("...")]
    return all(piece.strip() in printed for piece in pieces)


def done(step: Step, folder: Path, typed: str = "") -> "subprocess.CompletedProcess[str]":
    """Run a command to its end."""
    return subprocess.run(
        as_here(step),
        cwd=folder,
        text=True,
        input=typed,
        capture_output=True,
        timeout=PATIENCE_S,
        check=False,
    )


@contextmanager
def running(step: Step, folder: Path) -> Iterator["subprocess.Popen[str]"]:
    """Run a command until it has printed what is shown, and beyond; it ends with the block."""
    process = subprocess.Popen(
        as_here(step),
        cwd=folder,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None
    try:
        for line in step.printed:
            wait_for(line, process.stdout)
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if any(map(taken, PORTS)):
        pytest.skip(f"a program listens on port {' or '.join(map(str, PORTS))} already")
    folder = tmp_path_factory.mktemp("tutorial")
    (folder / "examples").symlink_to(ROOT / "examples")
    return folder


@pytest.fixture(scope="module")
def demo(folder: Path) -> Iterator["subprocess.Popen[str]"]:
    """The first step: the demo, running in a folder of its own, once it has printed all that is shown."""
    with running(DEMO, folder) as process:
        yield process


def test_the_tutorial_has_live_steps() -> None:
    assert [step.command.split()[-1] for step in (DEMO, TEACH, RECORD)] == ["demo", "sopra", "first"]
    names = [step.name for step in (DESCRIBE, FAKES, DOCTOR, SERVE, STATUS, FORCE, SAVE, GOTO)]
    assert names == ["specimen", "fakes", "doctor", "serve", "status", "print_force.py", "teach", "teach"]


def test_poses_are_taught_and_replayed(folder: Path, demo: "subprocess.Popen[str]") -> None:
    assert demo.poll() is None
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with (
        Arm("sopra", name="watcher") as watcher,
        subprocess.Popen(as_here(TEACH), cwd=folder, text=True, **pipes) as teaching,
    ):
        assert teaching.stdin is not None
        for _ in range(POSES):
            watcher.states().wait_for(lambda state: state.mode == "TEACH", PATIENCE_S)
            watcher.states().wait_for(lambda state: state.teach_pressures_pa is not None, PATIENCE_S)
            print(file=teaching.stdin, flush=True)
            watcher.states().wait_for(lambda state: state.mode == "HOLDING", PATIENCE_S)
            print(file=teaching.stdin, flush=True)
        out, _ = teaching.communicate("\n" * POSES, timeout=PATIENCE_S)
    assert teaching.returncode == 0
    assert shows(TEACH, out)


def test_a_recording_is_written_below_the_folder_of_the_demo(
    folder: Path, demo: "subprocess.Popen[str]"
) -> None:
    assert demo.poll() is None
    recorded = done(RECORD, folder)
    assert RECORD.shown == ("recording to ...",)
    path = re.search(r"^recording to (.+)$", recorded.stderr, re.MULTILINE)
    assert path is not None
    assert (folder / path[1]).is_file()
    assert (folder / "out" / "demo").resolve() in (folder / path[1]).resolve().parents


def test_ctrl_c_ends_the_demo(demo: "subprocess.Popen[str]") -> None:
    demo.send_signal(signal.SIGINT)
    demo.communicate(timeout=PATIENCE_S)
    assert demo.returncode == 0


def test_an_own_arm_is_served_watched_and_taught(folder: Path) -> None:
    assert not any(map(taken, PORTS)), "the demo has ended"
    assert done(DESCRIBE, folder, DESCRIBE.answers).returncode == 0
    with running(FAKES, folder) as fakes:
        checked = done(DOCTOR, folder)
        assert (checked.returncode, shows(DOCTOR, checked.stdout)) == (0, True)
        with running(SERVE, folder) as service:
            assert any(shows(STATUS, done(STATUS, folder).stdout) for _ in range(TRIES))
            with running(FORCE, folder):
                pass  # it prints a force
            for step, typed in ((SAVE, "\n\n"), (GOTO, "")):
                taught = done(step, folder, typed)
                assert taught.returncode == 0, taught.stderr
                assert shows(step, taught.stdout + taught.stderr), taught.stdout
            for process in (service, fakes):
                process.send_signal(signal.SIGINT)
                process.communicate(timeout=PATIENCE_S)
                assert process.returncode == 0
