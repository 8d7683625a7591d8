"""One session with QTM: version, names, stream, and what follows when its settings change."""

import asyncio
from typing import Final

from softarm.drivers.clock import NANOSECONDS, Clock
from softarm.drivers.errors import ConfigurationError, ConnectionLost, ProtocolError
from softarm.drivers.framing import FrameFault
from softarm.drivers.health import Health
from softarm.drivers.qualisys.bodies import decode_bodies
from softarm.drivers.qualisys.connection import PORT_CURE, QtmConnection, QtmError
from softarm.drivers.qualisys.packets import HEADER_LENGTH, PacketKind, QtmEvent, packet_text
from softarm.drivers.qualisys.parameters import STANDARD_EULER, Parameters, parse_parameters
from softarm.drivers.qualisys.publisher import MotionPublisher, QtmConfig

VERSIONS: Final = ("1.25", "1.24", "1.23", "1.22", "1.21", "1.20", "1.19")
"""Protocol versions, tried one after the other; a client that names none is served version 1.1."""

GREETING: Final = "QTM RT Interface connected"
"""What QTM greets with; its manual prints a full stop behind it, QTM itself does not."""

WAITING = "waiting"
NAMES = "names"
_STARTING: Final = frozenset({QtmEvent.CAPTURE_STARTED, QtmEvent.RT_FROM_FILE_STARTED})
_RENAMING: Final = _STARTING | {QtmEvent.CAMERA_SETTINGS_CHANGED}


class QtmSession:
    """A session on an open connection."""

    def __init__(
        self,
        config: QtmConfig,
        connection: QtmConnection,
        publisher: MotionPublisher,
        health: Health,
        clock: Clock,
    ) -> None:
        self._config = config
        self._device = config.name
        self._connection = connection
        self._publisher = publisher
        self._health = health
        self._clock = clock
        self._wake = asyncio.Event()
        self._names_due = False
        self._stream_due = False
        self._names_requested_ns = 0
        connection.listener = self

    async def identify(self) -> None:
        """Greet, agree on a version, read the names and request the stream.

        Raises:
            ConnectionLost: QTM accepts no more clients, or does not answer.
            ConfigurationError: QTM speaks none of the versions, or measures angles of another convention.
            ProtocolError: What answers is not QTM.
        """
        self._publisher.connected()
        await self._greet()
        self._health.facts["protocol"] = await self._agree_on_version()
        self._health.facts["version"] = packet_text(await self._request("QTMVersion", PacketKind.COMMAND))
        state = await self._request("GetState", PacketKind.EVENT)
        self._health.facts["state"] = _event_name(state[HEADER_LENGTH])
        await self._read_names()  # before the stream, whose bodies bear no names
        self._start_stream()

    async def stream(self) -> None:
        """Serve the session until the connection is lost, and raise what ended it."""
        while True:
            try:
                async with asyncio.timeout(self._config.heartbeat_s):
                    await self._wake.wait()
            except TimeoutError:
                # While nothing is measured QTM answers `StreamFrames` with "no more data": repeat it.
                self._stream_due = self._stream_due or WAITING in self._health.alarms
            self._wake.clear()
            await self._follow()

    async def close(self) -> None:
        """End the stream and the connection."""
        self._connection.close()

    async def _follow(self) -> None:
        """Do what is due: fail, read names, request the stream, check that QTM is alive."""
        if self._connection.error is not None:
            raise self._connection.error
        now_ns = self._clock()
        if now_ns - self._connection.last_arrival_ns >= self._pause_ns:
            await self._check_alive(now_ns)
        if self._names_due and now_ns - self._names_requested_ns >= self._pause_ns:
            await self._read_names()
        if self._stream_due:
            self._start_stream()

    async def _check_alive(self, now_ns: int) -> None:
        """Request the state; anything that comes meanwhile is a sign of life as good as the answer."""
        answer = self._connection.expect(PacketKind.EVENT)
        self._connection.send("GetState")
        try:
            async with asyncio.timeout(self._config.answer_s):
                await answer
        except TimeoutError:
            self._health.timeouts += 1
            if self._connection.last_arrival_ns <= now_ns:
                raise self._unanswered("GetState") from None
            self._connection.withdraw(answer)

    @property
    def _pause_ns(self) -> int:
        """The heartbeat [ns]; names are read no more often, unless an event requires it."""
        return round(self._config.heartbeat_s * NANOSECONDS)

    def _start_stream(self) -> None:
        self._stream_due = False
        rate = "AllFrames" if self._config.divisor == 1 else f"FrequencyDivisor:{self._config.divisor}"
        self._connection.send(f"StreamFrames {rate} {self._config.component}")

    async def _greet(self) -> None:
        try:
            async with asyncio.timeout(self._config.answer_s):
                greeting = await self._connection.welcome()
        except TimeoutError:
            limit = self._config.answer_s
            raise ConnectionLost(
                self._device, "does not answer like QTM", PORT_CURE, limit=limit, unit="s"
            ) from None
        except QtmError as refusal:
            raise ConnectionLost(
                self._device, f"accepts no more clients: {refusal.what}", "close another client of QTM"
            ) from refusal
        if not greeting.startswith(GREETING):
            raise ProtocolError(self._device, f"greets with {greeting[:60]!r}", PORT_CURE)

    async def _agree_on_version(self) -> str:
        for version in VERSIONS:
            try:
                reply = packet_text(await self._request(f"Version {version}", PacketKind.COMMAND))
            except QtmError:
                continue
            if reply.lower().startswith("version set to"):
                return version
        raise ConfigurationError(
            self._device,
            f"QTM speaks none of the protocol versions {VERSIONS[-1]} to {VERSIONS[0]}",
            "update QTM",
        )

    async def _read_names(self) -> None:
        """Read the settings; their names hold only if nothing changed meanwhile."""
        self._names_due = False
        self._names_requested_ns = self._clock()
        try:
            packet = await self._request("GetParameters General 6D", PacketKind.XML)
        except QtmError as refusal:
            self._no_names(refusal.what)
            return
        parameters = parse_parameters(packet_text(packet))
        if isinstance(parameters, FrameFault):
            self._health.malformed += 1
            self._no_names(parameters.detail)
        elif not self._names_due:
            self._check_angles(parameters)
            self._publisher.learn_names(parameters)
            self._health.facts["bodies"] = ", ".join(parameters.bodies)
            self._health.events["body names read"] += 1
            self._health.alarms.clear(NAMES)

    def _no_names(self, why: str) -> None:
        self._names_due = True
        self._health.alarms.set(
            NAMES, f"the names of the bodies are not known: {why}", "define rigid bodies in QTM"
        )

    def _check_angles(self, parameters: Parameters) -> None:
        if "Euler" in self._config.component and parameters.euler not in ((), STANDARD_EULER):
            what = f"QTM names its angles {', '.join(parameters.euler)}, not {', '.join(STANDARD_EULER)}"
            raise ConfigurationError(self._device, what, "stream 6D, or restore the standard angles in QTM")

    async def _request(self, command: str, kind: PacketKind) -> bytes:
        sent_ns = self._clock()
        try:
            async with asyncio.timeout(self._config.answer_s):
                packet = await self._connection.request(command, kind)
        except TimeoutError:
            self._health.timeouts += 1
            raise self._unanswered(command) from None
        self._health.round_trip.add(self._clock() - sent_ns)
        return packet

    def _unanswered(self, command: str) -> ConnectionLost:
        what, cure = f"does not answer {command}", "check QTM and the network"
        error = ConnectionLost(self._device, what, cure, limit=self._config.answer_s, unit="s")
        self._connection.fail(error)
        return error

    def on_data(self, packet: bytes, arrival_ns: int) -> None:
        """Publish the bodies of a data packet."""
        frame = decode_bodies(packet)
        if frame is None:
            self._health.events["frames without bodies"] += 1
            return
        if isinstance(frame, FrameFault):
            self._health.malformed += 1
            return
        self._health.alarms.clear(WAITING)
        if not self._publisher.publish(frame, arrival_ns) and not self._names_due:
            self._names_due = True
            self._wake.set()

    def on_event(self, event: int) -> None:
        """Follow an event of QTM."""
        self._health.events[_event_name(event)] += 1
        if event == QtmEvent.SHUTTING_DOWN:
            self._connection.fail(ConnectionLost(self._device, "QTM is shutting down", "start QTM"))
            return
        if event in _RENAMING:
            self._publisher.forget_names(self._clock())
            self._names_due = True
            self._names_requested_ns -= self._pause_ns  # at once, however short ago they were read
            self._stream_due = self._stream_due or event in _STARTING
            self._wake.set()

    def on_no_more_data(self) -> None:
        """Raise the alarm that no measurement runs."""
        self._health.events["no more data"] += 1
        self._health.alarms.set(
            WAITING, "no measurement runs in QTM", "start a capture or the preview in QTM"
        )

    def on_error(self, text: str) -> None:
        """Fail the connection: an error that answers no request can only be about the stream."""
        self._health.rejected += 1
        self._connection.fail(
            ProtocolError(self._device, f"QTM refuses the stream: {text!r}", "check `component`")
        )

    def on_fault(self, fault: FrameFault) -> None:
        """Count what is no packet of use."""
        if fault.kind == "unknown":
            self._health.events["unknown packets"] += 1
        else:
            self._health.malformed += 1

    def on_unexpected(self, text: str) -> None:
        """Count a reply without a request."""
        self._health.rejected += 1
        self._health.facts["unexpected reply"] = text

    def on_lost(self) -> None:
        """Wake `stream`, which raises what ended the connection."""
        self._wake.set()


def _event_name(event: int) -> str:
    return QtmEvent(event).name.lower().replace("_", " ") if event in set(QtmEvent) else f"event {event}"
