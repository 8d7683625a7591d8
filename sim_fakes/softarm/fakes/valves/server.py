"""The Modbus TCP port of a terminal: framing, several clients, and what goes wrong with both."""

import asyncio
import socket

from softarm.fakes.clock import Clock
from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.parts import ValvesPart
from softarm.fakes.tcp import reset
from softarm.fakes.valves.modbus import LONGEST_PDU, MBAP, execute
from softarm.fakes.valves.node import DEVICE_BUSY, CpxNode

SEGMENT_GAP = 3e-3

WIRE_FAULTS = (
    Fault("node_down", "connections are reset and refused; outputs are off when it comes back"),
    Fault("freeze", "connections stay open, requests are neither served nor answered"),
    Fault(
        "drop_after_request",
        "the connection is reset instead of an answer",
        once=True,
        parameters={"served": True},
    ),
    Fault("late_reply", "an answer comes late, after those of later requests", True, {"delay_s": 0.15}),
    Fault("delay", "every answer comes late", parameters={"delay_s": 0.02}),
    Fault(
        "exception",
        "exception answer; the request is not served",
        once=True,
        parameters={"code": DEVICE_BUSY},
        limits={"code": (1, 255)},
    ),
    Fault("short_reply", "one register fewer than requested", once=True),
    Fault("wrong_function", "answer with another function code", once=True),
    Fault("wrong_transaction", "answer with another transaction id", once=True),
    Fault("wrong_protocol", "answer with a protocol id that is not 0", once=True),
    Fault("split_reply", "answers arrive in two TCP segments"),
    Fault("garbage", "random bytes before an answer", True, {"size": 7}, {"size": (1, 1000)}),
    Fault("refuse", "new connections are closed at once, as when the node has too many"),
)


class ModbusPort:
    """Serves a node on a TCP port.

    Args:
        part: Its description.
        node: The registers.
        faults: The board with at least ``WIRE_FAULTS``.
        clock: The fakes' clock.
        host: Address to listen on.
    """

    def __init__(self, part: ValvesPart, node: CpxNode, faults: FaultBoard, clock: Clock, host: str) -> None:
        self.node = node
        self.faults = faults
        self.clock = clock
        self.requests = 0
        self.host, self.port = host, part.port
        self.most_clients = part.max_clients
        self.links: set[_Link] = set()
        self._server: asyncio.Server | None = None
        self._switching: asyncio.Task[None] | None = None
        faults.listen(self._on_fault)

    async def start(self) -> None:
        """Listen; ``port`` then holds the number."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: _Link(self), self.host, self.port)
        self.port = self._server.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        """Stop listening and reset every connection."""
        if self._switching is not None:
            await self._switching
        self._close()

    def _close(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None
        for link in list(self.links):
            link.reset()

    def _on_fault(self, name: str, active: bool) -> None:
        if name != "node_down":
            return
        if active:
            self.faults.hit("node_down")
            self._close()
        else:
            self.node.power_on()
            self._switching = asyncio.get_running_loop().create_task(self.start())


class _Link(asyncio.Protocol):
    """One connection."""

    def __init__(self, port: ModbusPort) -> None:
        self._port = port
        self._buffer = bytearray()
        self._held: bytearray | None = None
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        full = len(self._port.links) >= self._port.most_clients
        self._port.links.add(self)
        if self._port.faults.hit("refuse") or full:
            transport.close()

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        self._port.links.discard(self)
        self._transport = None

    def data_received(self, data: bytes) -> None:
        self._buffer += data
        while len(self._buffer) > MBAP.size:
            transaction, protocol, length, unit = MBAP.unpack_from(self._buffer)
            if protocol != 0 or not 2 <= length <= LONGEST_PDU + 1:
                self.reset()
                return
            end = MBAP.size - 1 + length
            if len(self._buffer) < end:
                return
            pdu = bytes(self._buffer[MBAP.size : end])
            del self._buffer[:end]
            self._serve(transaction, unit, pdu)

    def reset(self) -> None:
        """Close with a TCP reset instead of an orderly end."""
        reset(self._transport)

    def _serve(self, transaction: int, unit: int, pdu: bytes) -> None:
        port, faults = self._port, self._port.faults
        if faults.hit("freeze"):
            return  # before the watchdog is fed: a frozen node serves nobody
        port.requests += 1
        port.node.note_request(port.clock.now())
        if dropped := faults.hit("drop_after_request"):
            if dropped["served"]:
                execute(port.node, pdu)
            self.reset()
            return
        if refused := faults.hit("exception"):
            answer = bytes([pdu[0] | 0x80, int(refused["code"])])
        else:
            answer = self._bend_answer(execute(port.node, pdu))
        self._send(self._frame(transaction, unit, answer))

    def _bend_answer(self, answer: bytes) -> bytes:
        """Apply the faults that change an answering PDU."""
        faults = self._port.faults
        if answer[0] in (3, 23) and faults.hit("short_reply"):
            answer = bytes([answer[0], answer[1] - 2]) + answer[2:-2]
        if faults.hit("wrong_function"):
            answer = bytes([4 if answer[0] != 4 else 3]) + answer[1:]
        return answer

    def _frame(self, transaction: int, unit: int, answer: bytes) -> bytes:
        faults = self._port.faults
        if faults.hit("wrong_transaction"):
            transaction = (transaction + 0x5555) & 0xFFFF
        protocol = 0x4242 if faults.hit("wrong_protocol") else 0
        frame = MBAP.pack(transaction, protocol, len(answer) + 1, unit) + answer
        if garbage := faults.hit("garbage"):
            frame = bytes((37 * k + 165) & 0xFF for k in range(int(garbage["size"]))) + frame
        return frame

    def _send(self, frame: bytes) -> None:
        faults = self._port.faults
        delay = 0.0
        for name in ("delay", "late_reply"):
            if late := faults.hit(name):
                delay += float(late["delay_s"])
        if delay:
            asyncio.get_running_loop().call_later(delay, self._write, frame)
        else:
            self._write(frame)

    def _write(self, frame: bytes) -> None:
        if self._held is not None:
            self._held += frame  # behind the second half of a split answer: TCP keeps the order
        elif self._transport is None or self._transport.is_closing():
            return
        elif self._port.faults.hit("split_reply"):
            half = len(frame) // 2
            self._transport.write(frame[:half])
            self._held = bytearray(frame[half:])
            asyncio.get_running_loop().call_later(SEGMENT_GAP, self._release)
        else:
            self._transport.write(frame)

    def _release(self) -> None:
        """Send the second segment of a split answer and whatever has queued up behind it."""
        if self._held is not None and self._transport is not None and not self._transport.is_closing():
            self._transport.write(bytes(self._held))
        self._held = None
