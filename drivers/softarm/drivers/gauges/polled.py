"""Force gauges that are polled: Mark-10 (GCL2) and Sauter FH."""

import asyncio
from abc import abstractmethod
from typing import Annotated, Generic, Literal

from pydantic import Field

from softarm.drivers.clock import NANOSECONDS, Clock, PollTicker, monotonic
from softarm.drivers.config import Seconds
from softarm.drivers.errors import ProtocolError
from softarm.drivers.gauges import mark10, sauter
from softarm.drivers.gauges.device import ForceGauge, GaugeConfig, UnitName
from softarm.drivers.gauges.mark10 import Mark10Error, Mark10Reply, Mark10Settings, mark10_codec
from softarm.drivers.gauges.sample import GaugeSample
from softarm.drivers.gauges.sauter import SauterCodec
from softarm.drivers.reading import Sink, ignore
from softarm.drivers.serial_device import FrameT
from softarm.drivers.serial_link import Baud, Latency, SerialLink

POLARITY = "polarity"
PEAK = "peak"
REVERSAL_N = 0.2
"""Smallest load [N] before and after a change of sign that makes the settings doubtful."""

REFUSALS = 3
"""Error replies to `LIST` after which it counts as unknown; a damaged request may cause a single one."""


class PolledConfig(GaugeConfig):
    """Settings of a polled gauge.

    Attributes:
        poll_hz: Rate of the polls [Hz].
        answer_s: Time for an answer [s].
    """

    poll_hz: Annotated[float, Field(gt=0, le=100)] = 20.0
    answer_s: Annotated[float, Field(gt=0, le=5)] = 0.2


class PolledGauge(ForceGauge[FrameT], Generic[FrameT]):
    """A gauge that is polled for each reading; one request is open at a time."""

    config: PolledConfig
    _pending: asyncio.Future[FrameT] | None = None

    @abstractmethod
    async def poll(self, link: SerialLink) -> bool:
        """Request a reading, and return whether an answer came."""

    async def begin(self, link: SerialLink) -> None:
        """Poll until a first answer comes."""
        while not await self.poll(link):
            pass

    async def run(self, link: SerialLink) -> None:
        """Poll at the configured rate."""
        ticker = PollTicker(round(NANOSECONDS / self.config.poll_hz), self.clock)
        while True:
            tick = await ticker.wait()
            self.health.overruns += tick.skipped
            await self.poll(link)

    async def ask(self, link: SerialLink, request: bytes) -> FrameT | None:
        """Send a request and return its answer, or None if none comes in time; both are counted."""
        # Replies bear no number: a late one must not pass for the answer to this request.
        link.flush()
        self.codec.reset()
        self._pending = asyncio.get_running_loop().create_future()
        sent_ns = self.clock()
        link.write(request)
        try:
            async with asyncio.timeout(self.config.answer_s):
                answer = await self._pending
        except TimeoutError:
            self.health.timeouts += 1
            return None
        finally:
            self._pending = None
        self.health.round_trip.add(self.clock() - sent_ns)
        return answer

    def answered(self, frame: FrameT) -> None:
        """Complete the open request with its answer."""
        if self._pending is not None and not self._pending.done():
            self._pending.set_result(frame)


class Mark10Gauge(PolledGauge[Mark10Reply]):
    """A Mark-10 gauge. Its readings are trusted while `LIST` reports that they have a sign and are no peaks.

    A reading does not show whether somebody has inverted its sign, but a load that changes sign from one
    reading to the next may come from that: no reading is then trusted until the settings are read again.
    """

    def __init__(self, config: "Mark10Config", sink: Sink, clock: Clock, *, observe: bool) -> None:
        super().__init__(config, mark10_codec(), "GCL2 replies", sink, clock, observe=observe)
        self._settings: Mark10Settings | None = None
        self._check_ns = round(config.settings_s * NANOSECONDS)
        self._checked_ns = 0
        self._last_gross = 0.0
        self._doubtful = False

    def restarted(self) -> None:
        """Forget the settings, which may have been changed meanwhile."""
        super().restarted()
        self._settings = None
        self._last_gross = 0.0

    async def begin(self, link: SerialLink) -> None:
        """Read the settings, then a first reading.

        Raises:
            ProtocolError: The gauge does not support `LIST`.
        """
        # Before any reading: without them its sign and its unit mean nothing.
        refusals = 0
        while not isinstance(reply := await self._check_settings(link), Mark10Settings):
            refusals += isinstance(reply, Mark10Error)
            if isinstance(reply, Mark10Error) and refusals == REFUSALS:
                what = f"answers {reply.code}, {reply.meaning}, to LIST"
                raise ProtocolError(self.name, what, "use a gauge that speaks GCL2")
        await super().begin(link)

    async def poll(self, link: SerialLink) -> bool:
        """Request the displayed reading; from time to time the settings before it."""
        if self._doubtful or self.clock() - self._checked_ns > self._check_ns:
            await self._check_settings(link)
        return isinstance(await self.ask(link, mark10.READ), GaugeSample)

    def handle_frame(self, frame: Mark10Reply, arrival_ns: int) -> None:
        """Publish a reading, which may also come unrequested; keep settings; count errors."""
        if isinstance(frame, GaugeSample):
            self._publish(frame, arrival_ns)
        elif isinstance(frame, Mark10Error):
            self.health.rejected += 1
            self.health.events[f"error {frame.code}: {frame.meaning}"] += 1
        self.answered(frame)

    def _publish(self, sample: GaugeSample, arrival_ns: int) -> None:
        settings = self._settings
        unit = settings.unit if settings else None
        gross = self.scale.gross(sample, unit)
        if min(abs(gross), abs(self._last_gross)) >= REVERSAL_N and gross * self._last_gross < 0:
            self._doubtful = True
        self._last_gross = gross
        certain = settings is not None and settings.sends_polarity and not settings.shows_peak
        trusted = certain and not self._doubtful
        self.publish(sample, arrival_ns, unit=unit, trusted=trusted)

    async def _check_settings(self, link: SerialLink) -> Mark10Reply | None:
        """Request the settings, keep them and return the reply, whatever it is."""
        reply = await self.ask(link, mark10.LIST)
        if not isinstance(reply, Mark10Settings):
            return reply
        self._settings, self._checked_ns, self._doubtful = reply, self.clock(), False
        self.health.facts.update(firmware=reply.fields[0], settings=";".join(reply.fields))
        if not reply.sends_polarity:
            cure = "set the output to send polarity in the gauge's menu"
            self.health.alarms.set(POLARITY, "the gauge inverts or omits the sign", cure)
        else:
            self.health.alarms.clear(POLARITY)
        if reply.shows_peak:
            self.health.alarms.set(
                PEAK, "the gauge shows a peak, not the present force", "set the gauge to its current reading"
            )
        else:
            self.health.alarms.clear(PEAK)
        return reply


class SauterGauge(PolledGauge[GaugeSample]):
    """A Sauter FH or FL gauge; an answer ends with silence."""

    def __init__(self, config: "SauterConfig", sink: Sink, clock: Clock, *, observe: bool) -> None:
        self._codec = SauterCodec()
        super().__init__(config, self._codec, "7 characters such as 1021.15", sink, clock, observe=observe)
        self._silence_s = config.silence_s
        self._timer: asyncio.TimerHandle | None = None

    async def poll(self, link: SerialLink) -> bool:
        """Request the displayed reading."""
        self._stop_timer()
        try:
            return await self.ask(link, sauter.REQUEST) is not None
        finally:
            self._stop_timer()

    def receive(self, data: bytes, arrival_ns: int) -> None:
        """Collect bytes until none has come for a while."""
        super().receive(data, arrival_ns)
        self._stop_timer()
        loop = asyncio.get_running_loop()
        self._timer = loop.call_later(self._silence_s, self._silence, arrival_ns)

    def handle_frame(self, frame: GaugeSample, arrival_ns: int) -> None:
        """Publish the answer."""
        self.publish(frame, arrival_ns)
        self.answered(frame)

    def _silence(self, arrival_ns: int) -> None:
        self.accept(self._codec.silence(), arrival_ns)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()


class Mark10Config(PolledConfig):
    """A Mark-10 gauge with GCL2; it shows a pull as negative.

    Attributes:
        settings_s: How often its settings are read again, for the operator may change them [s].
    """

    kind: Literal["mark10"] = "mark10"
    baud: Baud = 115200
    pull_sign: Literal[-1, 1] = -1
    settings_s: Seconds = 1.0

    def build(self, sink: Sink = ignore, clock: Clock = monotonic, *, observe: bool = False) -> Mark10Gauge:
        """Build the device; no I/O before its `connect`."""
        return Mark10Gauge(self, sink, clock, observe=observe)


class SauterConfig(PolledConfig):
    """A Sauter FH or FL gauge; it does not send its unit.

    Attributes:
        unit: Unit of the display; the gauge does not send it.
        silence_s: Silence that ends an answer [s]; a USB adapter delivers in portions up to 16 ms apart.
        latency_s: An answer of 7 characters at 9600 baud takes 7 ms [s].
    """

    kind: Literal["sauter"] = "sauter"
    baud: Baud = 9600
    unit: UnitName
    silence_s: Annotated[float, Field(gt=0, le=0.1)] = 0.025
    latency_s: Latency = 0.007
    poll_hz: Annotated[float, Field(gt=0, le=25)] = 15.0

    def build(self, sink: Sink = ignore, clock: Clock = monotonic, *, observe: bool = False) -> SauterGauge:
        """Build the device; no I/O before its `connect`."""
        return SauterGauge(self, sink, clock, observe=observe)
