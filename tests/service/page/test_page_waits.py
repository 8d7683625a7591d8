"""The page before its service is there, and what it needs to start."""

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import urllib.request

import pytest

pytest.importorskip("viser", reason="viser is not installed: softarm[page]")

from softarm.page.server import page_server
from softarm.page.waiting import ask_arm, wait_for_arm
from softarm_client import Arm
from softarm_client.errors import SetupError, UnreachableError
from tests.service.page.test_server import free_port


@pytest.fixture
def server():
    with page_server("127.0.0.1", free_port(), "<left> arm") as opened:
        yield opened


def texts(server):
    return [handle.content for handle in server.gui._gui_input_handle_from_uuid.values()]


def test_the_page_imports_neither_the_compiler_nor_the_solvers():
    code = "import softarm.page.app, sys; sys.exit(str({'numba', 'proxsuite'} & set(sys.modules) or ''))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


def test_the_title_is_the_name_of_the_arm(server):
    for encoding in ("identity", "gzip"):
        address = f"http://127.0.0.1:{server.get_port()}"
        request = urllib.request.Request(address, headers={"Accept-Encoding": encoding})
        with urllib.request.urlopen(request, timeout=10.0) as answer:
            page = answer.read()
        assert b"<title>&lt;left&gt; arm</title>" in page


def test_the_page_waits_for_its_service_and_says_for_what(server, service):
    said, tries = [], []

    def connect():
        tries.append(None)
        if len(tries) < 3:
            raise UnreachableError("network", "nothing answers", "start it")
        return Arm("page", service.endpoint)

    arm = wait_for_arm(server, connect, said.append, lambda: False)
    with arm.client:
        assert said == ["waiting for the service: network: nothing answers; start it"]
        assert len(arm.specimen.chambers) == 6
        assert len(arm.surface.rest_m) == 1 + max(max(triangle) for triangle in arm.surface.triangles)
        assert ask_arm(arm.client).surface == arm.surface


def test_a_wait_that_is_ended_opens_nothing(server):
    def connect():
        raise UnreachableError("network", "nothing answers", "start it")

    assert wait_for_arm(server, connect, lambda _: None, lambda: True) is None


def test_an_address_that_never_answers_is_not_waited_for(server):
    def connect():
        return Arm("page", "nonsense")

    with pytest.raises(SetupError, match="nonsense"):
        wait_for_arm(server, connect, lambda _: None, lambda: True)


@contextlib.contextmanager
def page_process(*arguments):
    command = [sys.executable, "-m", "softarm", "page", *arguments]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def test_the_command_waits_serves_and_ends_on_a_signal():
    port = free_port()
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with page_process("--arm", "page", "--endpoint", endpoint, "--port", str(port)) as page:
        assert page.stdout.readline() == f"operator page: http://127.0.0.1:{port}\n"
        assert re.match(f"waiting for the service: .*{endpoint}.*nothing answers", page.stderr.readline())
        page.send_signal(signal.SIGTERM)
        assert page.wait(30) == 0


def test_a_taken_port_may_be_tried_again_and_a_foreign_address_not():
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = str(other.getsockname()[1])
        with page_process("--arm", "page", "--port", port) as page:
            assert page.wait(60) == 1
            assert f"127.0.0.1:{port}: cannot serve the page" in page.stderr.read()
    with page_process("--arm", "page", "--host", "192.0.2.1", "--port", "8080") as page:
        assert page.wait(60) == 2
