"""The RT port of QTM: several clients, streams, and what goes wrong on the connection."""

import asyncio
import socket
import struct
from collections.abc import Callable, Sequence

from softarm.fakes.clock import Clock
from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.parts import QtmPart
from softarm.fakes.plant.state import PlantState
from softarm.fakes.qtm import packets
from softarm.fakes.qtm.measurement import MotionMeasurement
from softarm.fakes.qtm.packets import HEADER, MeasuredFrame
from softarm.fakes.qtm.session import WELCOME, ClientSession, FrameStream
from softarm.fakes.tcp import reset

MOST_CLIENTS = 10
LONGEST_COMMAND = 65536
BACKLOG_LIMIT = 1 << 20
SEGMENT_GAP = 2e-3
COALESCED = 5

CAPTURE_STARTED, CAPTURE_STOPPED, SETTINGS_CHANGED, SHUTTING_DOWN = 3, 4, 11, 12

SERVER_FAULTS = (
    Fault("no_more_data", "the measurement stops: packet type 4 and event 4; a new one begins when cleared"),
    Fault(
        "settings_changed",
        "the bodies change in the project: event 11 and other data",
        once=True,
        parameters={"action": "rotate"},
        limits={"action": ("rotate", "remove", "restore")},
    ),
    Fault("shutdown", "event 12, then connections are reset and refused until cleared"),
    Fault("reset_connection", "every connection is reset", once=True),
    Fault("silence", "connections stay open, nothing is sent and no command is answered"),
    Fault("zero_size", "a packet header with size 0 instead of a frame", once=True),
    Fault("huge_size", "a packet header with size 4294967295 instead of a frame", once=True),
    Fault("unknown_type", "a packet of type 77 in addition to a frame", once=True),
    Fault("truncated_component", "a component that claims more bytes than its packet has", once=True),
    Fault("split", "packets arrive in two TCP segments"),
    Fault("coalesce", "packets arrive five at a time"),
    Fault("latency", "frames arrive late", parameters={"seconds": 0.1}, limits={"seconds": (0, 60)}),
    Fault("full", "the next client is refused as the eleventh"),
    Fault("udp_loss", "every fourth datagram is lost"),
)


class QtmServer:
    """QTM with one project: a measurement, its settings and up to ten clients.

    Args:
        part: Its description.
        measurement: Source of the frames.
        state: Returns the latest snapshot of the arm.
        faults: The board with at least ``SERVER_FAULTS`` and the faults of the measurement.
        clock: The fakes' clock.
        host: Address to listen on.
    """

    def __init__(
        self,
        part: QtmPart,
        measurement: MotionMeasurement,
        state: Callable[[], PlantState],
        faults: FaultBoard,
        clock: Clock,
        host: str,
    ) -> None:
        self.measurement = measurement
        self.faults = faults
        self.host, self.port = host, part.port
        major, minor = part.newest_version.split(".")
        self.newest_version = (int(major), int(minor))
        self.password = part.password
        self.clients: set[_Client] = set()
        self.master: ClientSession | None = None
        self.last_event = CAPTURE_STARTED
        self.last_frame: MeasuredFrame | None = None
        self._state = state
        self._clock = clock
        self._latency = part.latency_s
        self._all_bodies = list(measurement.bodies)
        self._running = True
        self._server: asyncio.Server | None = None
        self._switching: asyncio.Task[None] | None = None
        self._datagrams: asyncio.DatagramTransport | None = None
        self._datagram_count = 0
        faults.listen(self._on_fault)

    @property
    def rate(self) -> float:
        """Camera rate [Hz]."""
        return self.measurement.part.rate_hz

    @property
    def body_names(self) -> Sequence[str]:
        """Names of the bodies in the order of the frames."""
        return [body.name for body in self.measurement.bodies]

    async def start(self) -> None:
        """Listen; ``port`` then holds the number."""
        loop = asyncio.get_running_loop()
        self._server = await loop.create_server(lambda: _Client(self), self.host, self.port)
        self.port = self._server.sockets[0].getsockname()[1]
        if self._datagrams is None:
            self._datagrams, _ = await loop.create_datagram_endpoint(
                asyncio.DatagramProtocol, local_addr=(self.host, 0)
            )

    async def stop(self) -> None:
        """Stop listening and reset every connection."""
        if self._switching is not None:
            await self._switching
        self._close()
        if self._datagrams is not None:
            self._datagrams.close()
            self._datagrams = None

    async def run(self) -> None:
        """Measure and send frames, forever."""
        self.begin()
        while True:
            await self._clock.sleep_until(self.measurement.next_time())
            self.measurement.skip_to(self._clock.now())
            frame = self.measurement.capture(self._state()) if self._running else None
            if again := self.faults.hit("restart"):
                self._restart(announced=bool(again["announced"]))
            elif not self._running:
                # Keeps the next exposure in the future, so that this loop waits and does not spin.
                self.measurement.start(self._clock.now())
            elif frame is not None:
                self.last_frame = frame
                self._send_after(self._delay(), frame)

    def begin(self) -> None:
        """Start a measurement."""
        self._running = True
        self.measurement.start(self._clock.now())
        # Before the first exposure `GetCurrentFrame` has something to return, with every body lost.
        self.last_frame = MeasuredFrame(0, 0, [None for _ in self.measurement.bodies])
        self.announce(CAPTURE_STARTED)

    def end(self) -> None:
        """Stop the measurement: streams end with a no-more-data packet."""
        self._running = False
        self.last_frame = None
        for client in self.clients:
            if client.session.stream is not None:
                client.session.stream = None
                client.send(packets.packet(packets.NO_MORE_DATA))
        self.announce(CAPTURE_STOPPED)

    def _restart(self, *, announced: bool) -> None:
        if announced:
            self.end()
            self.begin()
        else:
            self.measurement.start(self._clock.now())

    def announce(self, event: int) -> None:
        """Send every client an event; those that ``GetState`` may return are remembered."""
        if event not in (SETTINGS_CHANGED, SHUTTING_DOWN):
            self.last_event = event
        for client in self.clients:
            client.send(packets.event(event))

    def send_datagram(self, data: bytes, stream: FrameStream, peer: str) -> None:
        """Send a frame by UDP."""
        self._datagram_count += 1
        if stream.udp is None or self._datagrams is None:
            return
        if self._datagram_count % 4 == 0 and self.faults.hit("udp_loss"):
            return
        self._datagrams.sendto(data, (stream.udp[0] or peer, stream.udp[1]))

    def _delay(self) -> float:
        late = self.faults.hit("latency")
        return self._latency + (float(late["seconds"]) if late else 0.0)

    def _send_frame(self, frame: MeasuredFrame) -> None:
        encoded: dict[tuple[str, ...], bytes] = {}
        for client in list(self.clients):
            stream = client.session.stream
            if stream is None or not stream.due():
                continue
            if stream.components not in encoded:
                data = packets.data_packet(frame, stream.components)
                encoded[stream.components] = corrupt(data, self.faults)
            client.send_frame(encoded[stream.components], stream)

    def _send_after(self, delay: float, frame: MeasuredFrame) -> None:
        if delay > 0.0:
            asyncio.get_running_loop().call_later(delay, self._send_frame, frame)
        else:
            self._send_frame(frame)

    def _close(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None
        self._reset_all()

    def _reset_all(self) -> None:
        for client in list(self.clients):
            client.reset()

    def _on_fault(self, name: str, active: bool) -> None:
        if name == "no_more_data" and active and self._running:
            self.faults.hit(name)
            self.end()
        elif name == "no_more_data" and not active:
            self.begin()
        elif name == "settings_changed" and active:
            self._change_settings()
        elif name == "reset_connection" and active:
            self.faults.hit(name)
            self._reset_all()
        elif name == "shutdown" and active:
            self.faults.hit(name)
            self.announce(SHUTTING_DOWN)
            self._close()
        elif name == "shutdown":
            self._switching = asyncio.get_running_loop().create_task(self.start())

    def _change_settings(self) -> None:
        change = self.faults.hit("settings_changed")
        action = "" if change is None else change["action"]
        bodies = self.measurement.bodies
        if action == "rotate":
            self.measurement.bodies = bodies[1:] + bodies[:1]
        elif action == "remove":
            self.measurement.bodies = bodies[:-1] or bodies
        else:
            self.measurement.bodies = list(self._all_bodies)
        self.announce(SETTINGS_CHANGED)


def corrupt(data: bytes, faults: FaultBoard) -> bytes:
    """Apply the faults that change the bytes of a data packet."""
    if faults.hit("zero_size"):
        data = struct.pack("<II", 0, packets.DATA) + data[8:]
    if faults.hit("huge_size"):
        data = struct.pack("<II", 0xFFFFFFFF, packets.DATA) + data[8:]
    if faults.hit("truncated_component"):
        data = data[:24] + struct.pack("<I", len(data)) + data[28:]
    if faults.hit("unknown_type"):
        data = packets.packet(77, b"\x01\x02\x03") + data
    return data


class _Client(asyncio.Protocol):
    """One connection."""

    def __init__(self, server: QtmServer) -> None:
        self._server = server
        self._buffer = bytearray()
        self._held = bytearray()
        self._held_packets = 0
        self._transport: asyncio.Transport | None = None
        self.session = ClientSession(server, "unknown")

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        transport.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.session.peer = transport.get_extra_info("peername")[0]
        if self._server.faults.hit("full") or len(self._server.clients) >= MOST_CLIENTS:
            refusal = "Connection refused. Max number of clients reached."
            transport.write(packets.text(packets.ERROR, refusal))
            transport.close()
            return
        self._server.clients.add(self)
        self.send(packets.text(packets.COMMAND, WELCOME))

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        self._transport = None
        self.session.close()
        self._server.clients.discard(self)

    def data_received(self, data: bytes) -> None:
        self._buffer += data
        while len(self._buffer) >= HEADER.size:
            size, kind = HEADER.unpack_from(self._buffer)
            if not HEADER.size <= size <= LONGEST_COMMAND:
                self.reset()
                return
            if len(self._buffer) < size:
                return
            words = bytes(self._buffer[HEADER.size : size]).split(b"\0")[0]
            del self._buffer[:size]
            if kind == packets.COMMAND and not self._server.faults.hit("silence"):
                self.send(self.session.answer(words.decode(errors="replace")))

    def send_frame(self, data: bytes, stream: FrameStream) -> None:
        """Send a frame over the transport that the client chose."""
        if self._server.faults.hit("silence"):
            return
        if stream.udp is not None:
            self._server.send_datagram(data, stream, self.session.peer)
        # A client that does not read loses frames; QTM does not keep them for it.
        elif self._transport is None or self._transport.get_write_buffer_size() <= BACKLOG_LIMIT:
            self._send_cut(data)

    def send(self, data: bytes) -> None:
        """Send bytes in order, behind what is being held back."""
        if self._held:
            self._held += data
        elif data and self._transport is not None and not self._transport.is_closing():
            self._transport.write(data)

    def _send_cut(self, data: bytes) -> None:
        """Send a packet whole, in two segments, or together with its successors."""
        faults = self._server.faults
        if faults.hit("coalesce"):
            self._held += data
            self._held_packets += 1
            if self._held_packets >= COALESCED:
                self._release()
        elif self._held_packets:
            self._held += data
            self._release()
        elif not self._held and faults.hit("split"):
            self.send(data[: len(data) // 2])
            self._held += data[len(data) // 2 :]
            asyncio.get_running_loop().call_later(SEGMENT_GAP, self._release)
        else:
            self.send(data)

    def _release(self) -> None:
        data, self._held, self._held_packets = bytes(self._held), bytearray(), 0
        self.send(data)

    def reset(self) -> None:
        """Close with a TCP reset instead of an orderly end."""
        reset(self._transport)
