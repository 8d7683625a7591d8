"""Discovery of QTM by UDP."""

import asyncio
import struct
from typing import cast

from softarm.fakes.qtm.packets import COMMAND, DISCOVER, HEADER

PORT = struct.Struct(">H")


def discovery_reply(request: bytes, base_port: int) -> tuple[bytes, int] | None:
    """Answer a discovery request.

    Args:
        request: The datagram.
        base_port: Base port of the server, one below its little-endian port.

    Returns:
        The reply and the port it goes to; None when the datagram is no request.
    """
    if len(request) != 10 or HEADER.unpack_from(request) != (10, DISCOVER):
        return None
    words = b"fake, QTM 2.3 (build 464), 8 cameras\0"
    size = HEADER.size + len(words) + PORT.size
    return HEADER.pack(size, COMMAND) + words + PORT.pack(base_port), PORT.unpack_from(request, 8)[0]


class Discovery(asyncio.DatagramProtocol):
    """Answers discovery requests.

    Args:
        base_port: Base port of the server.
    """

    def __init__(self, base_port: int) -> None:
        self._base_port = base_port
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport for the reply."""
        # asyncio's own datagram transport does not derive from this class before Python 3.12.
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        """Answer a request."""
        answer = discovery_reply(data, self._base_port)
        if answer is not None and self._transport is not None:
            self._transport.sendto(answer[0], (addr[0], answer[1]))
