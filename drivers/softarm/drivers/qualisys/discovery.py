"""Finds QTM hosts: a UDP request to one address, answered with the host's name and base port."""

import asyncio
import struct
from dataclasses import dataclass
from typing import Any, Final

from softarm.drivers.framing import FrameFault
from softarm.drivers.qualisys.packets import PacketKind

DISCOVERY_PORT: Final = 22226
_REQUEST: Final = struct.Struct("<II")
_LARGEST_REPLY: Final = 2048


@dataclass(frozen=True, slots=True)
class QtmHost:
    """A computer that runs QTM.

    Args:
        address: Its IP address.
        base_port: The port that the others count from; little-endian is one above.
        description: Its name, version and cameras, as it reports them.
    """

    address: str
    base_port: int
    description: str


def encode_discover(reply_port: int) -> bytes:
    """Encode the request; the port alone is big-endian."""
    return _REQUEST.pack(10, PacketKind.DISCOVER) + reply_port.to_bytes(2, "big")


def parse_reply(data: bytes, address: str) -> QtmHost | FrameFault:
    """Return the host that a reply describes, or what is wrong with it."""
    if not 11 <= len(data) <= _LARGEST_REPLY:
        return FrameFault("size", f"a discovery reply of {len(data)} bytes")
    size, kind = _REQUEST.unpack_from(data)
    text, end, _ = data[8:-2].partition(b"\0")
    if size != len(data) or kind != PacketKind.COMMAND or not end:
        return FrameFault("discovery", "not a discovery reply")
    return QtmHost(address, int.from_bytes(data[-2:], "big"), text.decode(errors="replace"))


async def discover(address: str, port: int = DISCOVERY_PORT, wait_s: float = 0.3) -> list[QtmHost]:
    """Send the request to one address, of a host or a broadcast, and collect replies.

    Args:
        address: Where the request goes, and nowhere else.
        port: Port that QTM listens on.
        wait_s: How long to collect [s].

    Raises:
        OSError: The address cannot be reached.
    """
    loop = asyncio.get_running_loop()
    transport, replies = await loop.create_datagram_endpoint(
        _Replies, local_addr=("0.0.0.0", 0), allow_broadcast=True
    )
    try:
        reply_port: int = transport.get_extra_info("sockname")[1]
        transport.sendto(encode_discover(reply_port), (address, port))
        await asyncio.sleep(wait_s)
    finally:
        transport.close()
    if replies.error is not None:
        raise replies.error
    return replies.hosts


class _Replies(asyncio.DatagramProtocol):
    """Collects hosts, each once."""

    def __init__(self) -> None:
        self.hosts: list[QtmHost] = []
        self.error: Exception | None = None

    def datagram_received(self, data: bytes, addr: tuple[str | Any, int]) -> None:
        host = parse_reply(data, addr[0])
        # Bounded: anybody on the network may answer.
        if isinstance(host, QtmHost) and host not in self.hosts and len(self.hosts) < 64:
            self.hosts.append(host)

    def error_received(self, exc: Exception) -> None:
        self.error = exc
