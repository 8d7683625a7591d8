"""A foreign web site cannot drive the page, and texts of clients do nothing in it."""

import html
import socket

import pytest

pytest.importorskip("viser", reason="viser is not installed: softarm[page]")

import viser
import websockets.sync.client as websocket_client
from hypothesis import example, given
from hypothesis import strategies as st
from websockets.exceptions import InvalidStatus

from softarm.common.errors import WorkFailedError
from softarm.estimator.errors import InputError
from softarm.page import server as page_server
from softarm.page.server import open_server, page_origins
from softarm.page.text import plain


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def server():
    port = free_port()
    opened = open_server("127.0.0.1", port, "test", page_origins("127.0.0.1", port, ["https://arm.lab"]))
    yield opened
    opened.stop()


def connect(server, origin):
    address = f"ws://127.0.0.1:{server.get_port()}"
    words = [f"viser-v{viser.__version__}"]
    with websocket_client.connect(address, origin=origin, subprotocols=words) as connection:
        return len(connection.recv(timeout=10.0))


def test_own_origins_are_answered(server):
    for origin in (f"http://127.0.0.1:{server.get_port()}", "https://arm.lab"):
        assert connect(server, origin) > 0


def test_foreign_origins_are_refused(server):
    port = server.get_port()
    for origin in ("http://evil.example", f"http://evil.example:{port}", "http://127.0.0.1:1", "null", None):
        with pytest.raises(InvalidStatus, match="403"):
            connect(server, origin)


def test_viser_that_lets_everybody_in_is_not_served(monkeypatch):
    monkeypatch.setattr(page_server, "_answering_only", lambda *_: pytest.MonkeyPatch.context())
    port = free_port()
    with pytest.raises(InputError, match="lets foreign web sites"):
        open_server("127.0.0.1", port, "test", ())
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", port)) != 0


def test_taken_port_is_named_and_no_other_is_taken(server):
    with pytest.raises(WorkFailedError, match=f"127.0.0.1:{server.get_port()}"):
        open_server("127.0.0.1", server.get_port(), "test", ())


def test_every_interface_needs_a_name():
    with pytest.raises(InputError, match="--origin http://NAME:8080"):
        page_origins("0.0.0.0", 8080)
    assert "http://arm:8080" in page_origins("0.0.0.0", 8080, ["http://arm:8080"])


@given(text=st.text(max_size=80))
@example(text="<script src=//e.x/a.js></script>")
@example(text="| ** [x](javascript:alert(1)) `{1+1}` &lt;")
def test_text_of_others_is_shown_as_it_is(text):
    written = plain(text)
    assert not set(written.replace("&#", "")) & set("<>&|*_`[](){}\\!#\"'\n:/")
    assert html.unescape(written) == " ".join(text.split()) or any(ord(c) < 0xA0 for c in text)
