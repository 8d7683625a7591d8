"""The live commands of docs/tutorial.md, run as written, print what the tutorial shows."""

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import pytest

from softarm_client import Arm

pytestmark = [pytest.mark.slow, pytest.mark.realtime, pytest.mark.timeout(500)]

ROOT = Path(__file__).parents[2]
TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text("utf-8")
LIVE = TUTORIAL[: TUTORIAL.index("## Part 2")]
STEPS = re.findall(r"^```\n\$ (.+)\n((?:.*\n)*?)```$", LIVE, re.MULTILINE)
PORTS = (7447, 8080)
"""Of the service and of the operator page, by default."""
POSES = 3
PATIENCE_S = 60.0


def as_here(command: str) -> list[str]:
    """Run a command of the tutorial in this environment: ``./run`` sets one up first."""
    first, *rest = command.split()
    return [sys.executable, "-m", "softarm", *rest] if first == "./run" else [sys.executable, *rest]


def taken(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def wait_for(line: str, stream: IO[str]) -> None:
    printed: list[str] = []
    for one in stream:
        if one.strip() == line:
            return
        printed.append(one)
    pytest.fail(f"the tutorial shows {line!r}, which was not printed:\n{''.join(printed[-10:])}")


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, "subprocess.Popen[str]"]]:
    """The first step: the demo, running in a folder of its own, once it has printed all that is shown."""
    if any(map(taken, PORTS)):
        pytest.skip(f"a program listens on port {' or '.join(map(str, PORTS))} already")
    folder = tmp_path_factory.mktemp("tutorial")
    (folder / "examples").symlink_to(ROOT / "examples")
    command, shown = STEPS[0]
    process = subprocess.Popen(
        as_here(command),
        cwd=folder,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None
    try:
        for line in shown.splitlines():
            if line != "...":
                wait_for(line, process.stdout)
        yield folder, process
    finally:
        process.kill()
        process.communicate()


def test_the_tutorial_has_live_steps() -> None:
    assert [command.split()[-1] for command, _ in STEPS] == ["demo", "sopra", "first"]


def test_poses_are_taught_and_replayed(demo: tuple[Path, "subprocess.Popen[str]"]) -> None:
    folder, _ = demo
    command, shown = STEPS[1]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with (
        Arm("sopra", name="watcher") as watcher,
        subprocess.Popen(as_here(command), cwd=folder, text=True, **pipes) as teaching,
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
    assert [line for line in shown.splitlines() if line != "..." and line not in out] == []


def test_a_recording_is_written_below_the_folder_of_the_demo(
    demo: tuple[Path, "subprocess.Popen[str]"],
) -> None:
    folder, _ = demo
    command, shown = STEPS[2]
    done = subprocess.run(
        as_here(command), cwd=folder, text=True, capture_output=True, timeout=PATIENCE_S, check=True
    )
    assert shown.strip() == "recording to ..."
    path = re.search(r"^recording to (.+)$", done.stderr, re.MULTILINE)
    assert path is not None
    assert (folder / path[1]).is_file()
    assert (folder / "out" / "demo").resolve() in (folder / path[1]).resolve().parents


def test_ctrl_c_ends_the_demo(demo: tuple[Path, "subprocess.Popen[str]"]) -> None:
    _, process = demo
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0
