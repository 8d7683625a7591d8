"""One TCP connection to QTM: packets in, commands out, each reply to its request."""

import asyncio
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, cast

from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.errors import ConnectionLost, DeviceError, ProtocolError
from softarm.drivers.qualisys.packets import (
    HEADER_LENGTH,
    NEVER_A_STATE,
    PacketKind,
    PacketParser,
    encode_command,
    packet_text,
)

if TYPE_CHECKING:
    from softarm.drivers.qualisys.session import QtmSession

PORT_CURE = "use the little-endian port of QTM, 22223 by default"


class QtmError(ProtocolError):
    """QTM answered a command with an error packet."""


class _Request(NamedTuple):
    kind: int
    answer: asyncio.Future[bytes]


class QtmConnection(asyncio.Protocol):
    """A connection, from the welcome to the end.

    QTM answers in the order of the requests. A request that was abandoned stays in line until its answer has
    come, so that the answer reaches nobody else.
    """

    def __init__(self, device: str, clock: Clock = monotonic) -> None:
        self.device = device
        self.error: DeviceError | None = None
        self.listener: QtmSession | None = None
        self.last_arrival_ns = clock()
        self._clock = clock
        self._parser = PacketParser()
        self._requests: deque[_Request] = deque()
        self._transport: asyncio.Transport | None = None
        self._handlers: dict[int, Callable[[bytes], None]] = {
            PacketKind.ERROR: self._on_error,
            PacketKind.COMMAND: self._on_reply,
            PacketKind.XML: self._on_reply,
            PacketKind.EVENT: self._on_event,
            PacketKind.NO_MORE_DATA: self._on_no_more_data,
        }
        self._welcome = self.expect(PacketKind.COMMAND)  # first in line: QTM speaks first

    async def welcome(self) -> str:
        """Wait for the greeting.

        Raises:
            QtmError: QTM accepts no more clients.
            DeviceError: The connection was lost.
        """
        return packet_text(await self._welcome)

    async def request(self, command: str, kind: PacketKind) -> bytes:
        """Send a command and return the packet that answers it.

        Raises:
            QtmError: QTM answered with an error.
            DeviceError: The connection was lost.
        """
        answer = self.expect(kind)
        self.send(command)
        return await answer

    def expect(self, kind: PacketKind) -> asyncio.Future[bytes]:
        """Return a future for the next packet of a kind, or an error."""
        answer: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        if self.error is not None:
            answer.set_exception(self.error)
        else:
            self._requests.append(_Request(kind, answer))
        return answer

    def withdraw(self, answer: asyncio.Future[bytes]) -> None:
        """Withdraw a request: its answer, should it still come, is an unexpected reply."""
        self._requests = deque(request for request in self._requests if request.answer is not answer)

    def send(self, command: str) -> None:
        """Send a command that has no answer."""
        if self._transport is not None:
            self._transport.write(encode_command(command))

    def fail(self, error: DeviceError) -> None:
        """End the connection; every open request fails at once."""
        if self.error is not None:
            return
        self.error = error
        while self._requests:
            answer = self._requests.popleft().answer
            if not answer.done():
                answer.set_exception(error)
                answer.exception()  # counts as retrieved: nobody may be waiting for it any more
        # Abort: `close` would wait for a peer that no longer reads.
        if self._transport is not None:
            self._transport.abort()
        if self.listener is not None:
            self.listener.on_lost()

    def close(self) -> None:
        """Stop the stream and end the connection."""
        self.listener = None
        if self.error is None and self._transport is not None:
            self.send("StreamFrames Stop")
            self._transport.close()
            self._transport = None
        self.fail(ConnectionLost(self.device, "was closed", "connect again"))

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport."""
        self._transport = cast(asyncio.Transport, transport)

    def connection_lost(self, exc: Exception | None) -> None:
        """Fail the open requests."""
        why = f": {exc}" if exc else ""
        self.fail(ConnectionLost(self.device, f"QTM closed the connection{why}", "check that QTM runs"))

    def data_received(self, data: bytes) -> None:
        """Dispatch the packets that these bytes complete."""
        self.last_arrival_ns = arrival_ns = self._clock()
        decoded = self._parser.feed(data)
        for kind, packet in decoded.frames:
            if kind == PacketKind.DATA:
                if self.listener is not None:
                    self.listener.on_data(packet, arrival_ns)
            else:
                self._handlers[kind](packet)
        for fault in decoded.faults:
            if self.listener is not None:
                self.listener.on_fault(fault)
            if fault.kind == "size":
                self.fail(ProtocolError(self.device, f"QTM sent {fault.detail}", PORT_CURE))

    def _on_error(self, packet: bytes) -> None:
        text = packet_text(packet)
        if self._requests:
            answer = self._requests.popleft().answer
            if not answer.done():
                answer.set_exception(
                    QtmError(self.device, f"QTM answers {text!r}", "see the messages in QTM")
                )
                answer.exception()
        elif self.listener is not None:
            self.listener.on_error(text)

    def _on_reply(self, packet: bytes) -> None:
        kind = packet[4]  # the low byte of the kind; the parser accepts no kind above 9
        if self._requests and self._requests[0].kind == kind:
            self._answer(packet)
        elif self.listener is not None:
            self.listener.on_unexpected(packet_text(packet)[:80])

    def _on_event(self, packet: bytes) -> None:
        # QTM answers `GetState` with an event, not with a reply.
        event = packet[HEADER_LENGTH]
        waits = self._requests and self._requests[0].kind == PacketKind.EVENT
        if waits and event not in NEVER_A_STATE:
            # An event before the answer passes for it; the answer is then an event of the same state.
            self._answer(packet)
        elif self.listener is not None:
            self.listener.on_event(event)

    def _on_no_more_data(self, packet: bytes) -> None:  # noqa: ARG002
        if self.listener is not None:
            self.listener.on_no_more_data()

    def _answer(self, packet: bytes) -> None:
        answer = self._requests.popleft().answer
        if not answer.done():
            answer.set_result(packet)
