import logging
import os
import re
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from softarm.cli.serve import logged_off_loop
from softarm.estimator.recording import Recording
from softarm.recordings import save_recording
from softarm_client import Arm
from softarm_client.errors import CommandRefusedError

pytestmark = pytest.mark.timeout(300)  # the estimator compiles its kernels in a fresh checkout

CONFIG = """
arm = "test"
specimen = "sopra"
[network]
listen = ["tcp/127.0.0.1:{port}"]
[control]
rate_hz = 50
model = "rod"
[[devices]]
name = "valves"
kind = "festo_mpa"
host = "127.0.0.1"
port = {nobody}
chambers = [0, 1, 2, 3, 4, 5]
maximum_pa = 65e3
[[devices]]
name = "bend"
kind = "bendlabs"
port = "/nonexistent"
[[sensors]]
kind = "bend"
section = "intermediate"
device = "bend"
channel = "0"
needed = true
"""


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


CRASH = """
from softarm import cli
from softarm.daemon.loop import ControlLoop

def fail(self, tick):
    raise ZeroDivisionError("the tick that fails")

ControlLoop.step = fail
cli.main()
"""


class Daemon:
    """``softarm serve`` as systemd runs it: a process with a notify socket."""

    def __init__(self, folder: Path, *arguments, code=None, port=None):
        self.port = port or free_port()
        config = folder / "service.toml"
        config.write_text(CONFIG.format(port=self.port, nobody=free_port()))
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(folder / "notify"))
        self.socket.settimeout(100.0)
        command = ["-m", "softarm"] if code is None else ["-c", code]
        self.log = folder / "service.log"
        with self.log.open("w") as log:
            self.process = subprocess.Popen(
                [sys.executable, *command, "serve", "--config", config, *arguments],
                stderr=log,
                env=os.environ | {"NOTIFY_SOCKET": str(folder / "notify")},
            )

    def wait_for(self, word):
        while word not in (told := self.socket.recv(256).decode()):
            pass
        return told

    def client(self):
        return Arm("test", f"tcp/127.0.0.1:{self.port}")

    def end(self):
        self.process.send_signal(signal.SIGTERM)
        status = self.process.wait(30)
        self.socket.close()
        return status


@pytest.fixture
def daemon(tmp_path):
    running = []

    def start(*arguments, code=None, port=None):
        running.append(Daemon(tmp_path, *arguments, code=code, port=port))
        return running[-1]

    yield start
    for process in running:
        process.process.kill()
        process.process.wait()
        process.socket.close()


def test_service_tells_systemd_and_refuses_to_arm_without_valves(daemon):
    service = daemon()
    service.wait_for("READY=1")
    service.wait_for("WATCHDOG=1")
    with service.client() as client:
        assert client.alive()
        with client.lease(), pytest.raises(CommandRefusedError, match="valve bank never answered"):
            client.arm()
        assert client.state().mode == "IDLE"
    assert service.end() == 0
    assert re.search(
        r"serving test at tcp/127\.0\.0\.1:\d+: specimen sopra, model rod, devices valves, bend",
        service.log.read_text(),
    )


def test_a_service_whose_port_is_taken_says_so_in_a_line_and_may_be_tried_again(daemon):
    with socket.create_server(("127.0.0.1", 0)) as other:
        service = daemon(port=other.getsockname()[1])
        assert service.process.wait(100) == 1
    (line,) = service.log.read_text().splitlines()
    assert line.endswith("check that the address is free and reachable")
    service.socket.close()


def test_an_internal_error_leaves_a_traceback_in_the_log(daemon, monkeypatch):
    service = daemon(code=CRASH)
    assert service.process.wait(100) == 1
    log = service.log.read_text()
    assert "Traceback" in log
    assert "the tick that fails" in log
    assert "STOPPING=1" in service.wait_for("STOPPING=1")


def test_replay_is_marked_alarms_nothing_and_moves_nothing(daemon, tmp_path):
    time = np.arange(0.0, 60.0, 0.02)
    columns = {f"pressure_{k}_pa": np.zeros_like(time) for k in range(6)}
    columns |= {f"bend_intermediate_{axis}_rad": np.zeros_like(time) for axis in "xy"}
    save_recording(Recording("still", time, columns, {"specimen": "sopra"}), tmp_path / "still.mcap")
    service = daemon("--replay", tmp_path / "still.mcap")
    service.wait_for("READY=1")
    with service.client() as client:
        state = client.states().wait_for(lambda s: s.measured_pa[0] is not None, 20.0)
        assert state.stamp.source == "replay"
        assert state.findings == ()
        with client.lease(), pytest.raises(CommandRefusedError, match="replayed"):
            client.arm()
    assert service.end() == 0


def test_a_log_that_nobody_takes_does_not_hold_up_the_loop():
    reader, writer = os.pipe()
    with (
        open(reader) as taken,  # noqa: PTH123
        open(writer, "w") as stream,  # noqa: PTH123
        logged_off_loop(False, stream),
    ):
        begin = time.monotonic()
        for number in range(100):  # more than a pipe holds
            logging.getLogger("softarm.test").warning("%d %s", number, "x" * 10_000)
        assert time.monotonic() - begin < 5.0
        lines = [taken.readline() for _ in range(100)]
    assert [line.split()[-2] for line in lines] == [str(number) for number in range(100)]
