"""Work in other processes ends with Ctrl-C, in silence but for the one that obeys it."""

import os
import signal
import subprocess
import sys

import pytest

from softarm.common.errors import WorkFailedError
from softarm.common.processes import processes

WAITING = """
import signal
import threading
from softarm.common.processes import processes

def endless(name):
    print(name, flush=True)
    threading.Event().wait()

if __name__ == "__main__":
    # A shell ignores Ctrl-C in what it starts in the background, and so would this.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with processes(2) as pool:
        waiting = [pool.submit(endless, name) for name in "abc"]
        waiting[0].result()
"""


def test_the_work_is_done_in_other_processes() -> None:
    with processes(2) as pool:
        assert os.getpid() not in {pool.submit(os.getpid).result() for _ in range(3)}


def test_the_error_of_a_piece_of_work_comes_out() -> None:
    with pytest.raises(ZeroDivisionError), processes(1) as pool:
        pool.submit(divmod, 1, 0).result()


def test_a_process_that_is_killed_fails_the_work_in_plain_words() -> None:
    with pytest.raises(WorkFailedError, match="lack of memory"), processes(1) as pool:
        pool.submit(os.kill, pool.submit(os.getpid).result(), signal.SIGKILL).result()


def test_ctrl_c_ends_all_and_only_the_first_process_reports_it(tmp_path) -> None:
    script = tmp_path / "waiting.py"
    script.write_text(WAITING)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([sys.executable, script], text=True, start_new_session=True, **pipes) as running:
        assert {running.stdout.readline().strip() for _ in range(2)} == {"a", "b"}
        os.killpg(running.pid, signal.SIGINT)
        _, printed = running.communicate(timeout=30.0)
    assert running.returncode == -signal.SIGINT
    assert printed.count("Traceback") == printed.count("KeyboardInterrupt") == 1
