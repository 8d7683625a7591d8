"""A TCP connection that breaks, as a device that loses its power breaks it."""

import asyncio
import socket
import struct


def reset(transport: asyncio.Transport | None) -> None:
    """Close a connection with a TCP reset instead of an orderly end."""
    if transport is not None:
        # To linger for no time makes the kernel drop what is queued and send RST in place of FIN.
        linger = struct.pack("ii", 1, 0)
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
        transport.abort()
