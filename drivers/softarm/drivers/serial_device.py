"""What instruments on a serial line have in common: from bytes to readings, and a session."""

import asyncio
from abc import abstractmethod
from typing import Any, Generic, TypeVar

from softarm.drivers.clock import NANOSECONDS, Clock
from softarm.drivers.device import Device
from softarm.drivers.errors import ConnectionLost, ProtocolError
from softarm.drivers.framing import Codec, Decoded, FrameFault
from softarm.drivers.reading import Sink, Value
from softarm.drivers.serial_link import SerialConfig, SerialLink, open_serial
from softarm.drivers.stream import ReadingStream

FrameT = TypeVar("FrameT")

FIRST_GARBAGE_LIMIT = 512
"""Bytes without a first good frame after which speed or protocol must be wrong."""

GARBAGE_LIMIT = 2048
"""Bytes without a good frame after which that is so although there were good ones before."""


class SerialDevice(Device, Generic[FrameT, Value]):
    """An instrument that sends frames of its own accord; a driver adds `codec` and `take`.

    Args:
        config: Its settings.
        codec: Parser of its bytes.
        expected: What its frames look like, for the error when none comes.
        sink: Receives each reading.
        clock: Host monotonic time.
        observe: Send nothing that changes a setting.
    """

    def __init__(
        self,
        config: SerialConfig,
        codec: Codec[FrameT],
        expected: str,
        sink: Sink,
        clock: Clock,
        *,
        observe: bool = False,
    ) -> None:
        super().__init__(config.name, config.source, timing=config.timing, clock=clock)
        self.serial = config
        self.codec = codec
        self.expected = expected
        self.observe = observe
        self.joined = asyncio.Event()
        self._last_fault = ""
        self.latency_ns = round(config.latency_s * NANOSECONDS)
        self.stream: ReadingStream[Value] = self.reading_stream(sink)

    async def open(self) -> "SerialSession":
        """Open the port."""
        link = await open_serial(self.serial, self.clock)
        # The counters go on, but earlier bytes do not show the speed of this connection.
        self.codec.reset()
        self.codec.counts.since_frame = 0
        self.joined.clear()
        self._last_fault = ""
        self.stream.start_epoch("connected")
        self.restarted()
        return SerialSession(self, link)

    @abstractmethod
    def handle_frame(self, frame: FrameT, arrival_ns: int) -> None:
        """Convert one good frame to a reading, an event or an alarm."""

    def receive(self, data: bytes, arrival_ns: int) -> None:
        """Decode a portion of bytes."""
        self.accept(self.codec.feed(data), arrival_ns)

    def accept(self, decoded: Decoded[FrameT], arrival_ns: int) -> None:
        """Count faults and convert frames."""
        for fault in decoded.faults:
            self.count(fault)
            self._last_fault = fault.detail
        for frame in decoded.frames:
            self.handle_frame(frame, arrival_ns)
            self.joined.set()

    def restarted(self) -> None:
        """Forget what held before the connection: sequence, device time."""

    async def begin(self, link: SerialLink) -> None:
        """Request data until the first good frame comes."""

    async def run(self, link: SerialLink) -> None:
        """Exchange data until the link is lost."""
        await link.wait_lost()

    def count(self, fault: FrameFault) -> None:
        """Count something on the line that is no frame."""
        if fault.kind == "checksum":
            self.health.bad_checksum += 1
        elif fault.kind == "framing":
            self.health.resyncs += 1
        elif fault.kind in ("range", "unit"):
            self.health.rejected += 1
        else:
            self.health.malformed += 1

    def garbage(self) -> ProtocolError:
        """Report that what comes is no frame of this instrument."""
        reason = f", but {self._last_fault}" if self._last_fault else ""
        what = f"no valid frame in {self.codec.counts.since_frame} bytes at {self.serial.baud} baud{reason}"
        return ProtocolError(self.name, what, f"wrong baud rate or wrong protocol; expected {self.expected}")


class SerialSession:
    """One connection of a `SerialDevice`."""

    def __init__(self, device: SerialDevice[Any, Any], link: SerialLink) -> None:
        self._device = device
        self._link = link
        link.on_bytes = self._on_bytes

    async def identify(self) -> None:
        """Wait for the first good frame.

        Raises:
            ConnectionLost: Nothing comes, or the device is unplugged.
            ProtocolError: What comes is no frame.
        """
        device, link = self._device, self._link
        try:
            async with asyncio.timeout(device.serial.identify_s):
                await link.while_open(device.begin(link))
                await link.while_open(device.joined.wait())
        except TimeoutError:
            if device.codec.counts.since_frame:
                raise device.garbage() from None
            cure = f"switch it on, check cable, port and baud rate; expected {device.expected}"
            what = f"sends nothing at {device.serial.baud} baud"
            raise ConnectionLost(device.name, what, cure, limit=device.serial.identify_s, unit="s") from None

    async def stream(self) -> None:
        """Exchange data until the link is lost."""
        await self._link.while_open(self._device.run(self._link))

    async def close(self) -> None:
        """Release the port."""
        self._link.close()

    def _on_bytes(self, data: bytes, arrival_ns: int) -> None:
        self._device.receive(data, arrival_ns)
        limit = GARBAGE_LIMIT if self._device.joined.is_set() else FIRST_GARBAGE_LIMIT
        if self._device.codec.counts.since_frame > limit:
            self._link.fail(self._device.garbage())
