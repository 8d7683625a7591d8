"""viser's server, open to the page's own origin only: another web site must not drive the arm."""

import errno
import html
import socket
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from importlib.resources import files
from inspect import isawaitable
from io import StringIO
from typing import Any
from unittest import mock

import viser
import websockets.asyncio.server as websocket_server
import websockets.sync.client as websocket_client
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import InvalidStatus, WebSocketException
from websockets.http11 import Request, Response
from websockets.typing import Origin, Subprotocol

from softarm.common.errors import WorkFailedError
from softarm.estimator.errors import InputError

FOREIGN = Origin("http://foreign.invalid")
PING_S, PONG_S = 2.0, 3.0
"""The server pings a browser after the first; without an answer for the second it no longer counts.

One that lost its network would otherwise count for 40 s, and hold a pose that nobody watches.
"""
ALL_INTERFACES = ("0.0.0.0", "::", "")
"""Addresses to listen on that no browser can name."""
TITLE = b"<title>Viser</title>"
"""Title of viser's own page, which it has no option for."""
HEAD = files(__package__).joinpath("head.html").read_bytes()
"""What the page adds to viser's own: its style, and a STOP that no panel hides."""
Answer = Callable[[ServerConnection, Request], Awaitable[Response | None] | Response | None]


def page_origins(host: str, port: int, more: Sequence[str] = ()) -> tuple[str, ...]:
    """List the origins that the page's own addresses have in a browser.

    Raises:
        InputError: The address is every interface, and no option names it for browsers.
    """
    if host in ALL_INTERFACES and not more:
        cure = f"name the address that browsers will use: --origin http://NAME:{port}"
        raise InputError("--host", f"{host} is every interface", cure)
    named = f"[{host}]" if ":" in host else host
    return tuple(dict.fromkeys((*(f"http://{n}:{port}" for n in (named, "127.0.0.1", "localhost")), *more)))


def open_server(host: str, port: int, label: str, origins: Sequence[str]) -> viser.ViserServer:
    """Open viser's server and make sure that it refuses foreign origins.

    viser answers WebSockets of every origin and has no option for it, so any web site in a browser that can
    reach the page could press its buttons.

    Raises:
        InputError: The address is not one of this host, or this version of viser lets foreign origins in.
        WorkFailedError: The port is in use.
    """
    _require_free(host, port)
    with (
        _answering_only(origins, label),
        redirect_stdout(StringIO()),
    ):  # viser's banner would come before our line
        server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
    if _accepts_foreign_origin("127.0.0.1" if host in ALL_INTERFACES else host, server.get_port()):
        server.stop()
        cure = "install the version of requirements.lock"
        raise InputError("viser", f"{viser.__version__} lets foreign web sites drive the page", cure)
    return server


@contextmanager
def page_server(host: str, port: int, arm: str, origins: Sequence[str] = ()) -> Iterator[viser.ViserServer]:
    """Serve an arm's page, without content as yet, within the block.

    Args:
        host: Address to serve the page on.
        port: Its TCP port.
        arm: The arm's name, which becomes the page's title.
        origins: Further origins that may use the page, such as that of a reverse proxy.

    Raises:
        InputError: The address cannot be served on.
        WorkFailedError: The port is in use.
    """
    server = open_server(host, port, arm, page_origins(host, port, origins))
    try:
        yield server
    finally:
        server.stop()


@contextmanager
def _answering_only(origins: Sequence[str], title: str) -> Iterator[None]:
    original, allowed = websocket_server.serve, [Origin(origin) for origin in origins]

    def serve(*arguments: Any, process_request: Answer, **options: Any) -> websocket_server.serve:
        titled = _titled(process_request, title)
        options |= {"process_request": titled, "origins": allowed}
        options |= {"ping_interval": PING_S, "ping_timeout": PONG_S}
        return original(*arguments, **options)

    with mock.patch.object(websocket_server, "serve", serve):
        yield


def _titled(answer: Answer, title: str) -> Answer:
    """Answer requests for the page with a title and a head of its own."""
    own = f"<title>{html.escape(title)}</title>".encode() + HEAD

    async def titled(connection: ServerConnection, request: Request) -> Response | None:
        if "Accept-Encoding" in request.headers:
            del request.headers["Accept-Encoding"]  # a compressed page cannot be changed
        answered = answer(connection, request)
        response = await answered if isawaitable(answered) else answered
        if response is not None and TITLE in response.body:
            response.body = bytes(response.body).replace(TITLE, own)
            del response.headers["Content-Length"]
            response.headers["Content-Length"] = str(len(response.body))
        return response

    return titled


def _require_free(host: str, port: int) -> None:
    """Refuse a port in use; viser would silently use the next one."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            what = f"cannot serve the page ({error.strerror})"
            if error.errno == errno.EADDRINUSE:  # what is there may end; a unit is started again
                cure = "stop what listens there, or choose another port"
                raise WorkFailedError(f"{host}:{port}: {what}; {cure}") from error
            raise InputError(f"{host}:{port}", what, "choose another by --host and --port") from error


def _accepts_foreign_origin(host: str, port: int) -> bool:
    """Return whether a WebSocket of a foreign origin is answered."""
    address = f"ws://[{host}]:{port}" if ":" in host else f"ws://{host}:{port}"
    wanted = [Subprotocol(f"viser-v{viser.__version__}")]
    try:
        with websocket_client.connect(address, origin=FOREIGN, subprotocols=wanted):
            return True
    except InvalidStatus:
        return False
    except (OSError, WebSocketException) as error:
        raise InputError(address, f"does not answer ({error})", "see the log") from error
