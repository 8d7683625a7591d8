"""Inertial units on a serial line; readings are `ImuSample`."""

import asyncio
from typing import Annotated, Any, Generic, Literal

from pydantic import Field

from softarm.drivers.clock import NANOSECONDS, Clock, monotonic
from softarm.drivers.framing import Codec
from softarm.drivers.imu import bno08x, xbus
from softarm.drivers.imu.quaternion_line import quaternion_line_codec
from softarm.drivers.imu.sample import ImuSample
from softarm.drivers.imu.sequence import IndexTracker, RateMonitor
from softarm.drivers.imu.xbus import XbusMessage, xbus_codec
from softarm.drivers.reading import Sink, ignore
from softarm.drivers.serial_device import FrameT, SerialDevice
from softarm.drivers.serial_link import Baud, Latency, SerialConfig, SerialLink

RATE = "rate"
RATE_TOLERANCE = 0.2
RATE_WINDOW_S = 2.0
RESTARTED = "unit restarted"
RESTART_NS = 800_000_000
"""Silence after which a unit without a sequence number may have started anew [ns]."""

SILENT_S = 1.0
"""Silence after which an Xsens unit is commanded to measure [s]."""

Rate = Annotated[float, Field(gt=0, le=2000)]


class ImuConfig(SerialConfig):
    """Settings of any inertial unit.

    Attributes:
        rate_hz: Rate that the unit is set to [Hz]; another measured rate is an alarm.
        unit: Which of several sensors on one line.
    """

    rate_hz: Rate = 100.0
    unit: Annotated[int, Field(ge=1, le=99)] = 1


class Imu(SerialDevice[FrameT, ImuSample], Generic[FrameT]):
    """An inertial unit.

    Its heading is relative to its start, so each restart begins an epoch.

    Args:
        config: Its settings.
        codec: Parser of its bytes.
        expected: What its frames look like.
        index: Follows its sequence number; None if it has none.
        sink: Receives each reading.
        clock: Host monotonic time.
        observe: Send nothing that changes a setting.
    """

    def __init__(
        self,
        config: ImuConfig,
        codec: Codec[FrameT],
        expected: str,
        index: IndexTracker | None,
        sink: Sink = ignore,
        clock: Clock = monotonic,
        *,
        observe: bool = False,
    ) -> None:
        super().__init__(config, codec, expected, sink, clock, observe=observe)
        self.rate_hz = config.rate_hz
        self.rate = RateMonitor(round(RATE_WINDOW_S * NANOSECONDS))
        self._unit = config.unit
        self._index = index
        self._arrival_ns: int | None = None

    def restarted(self) -> None:
        """Forget sequence and rate."""
        self.rate.restart()
        self._arrival_ns = None
        if self._index is not None:
            self._index.restart()

    def handle_frame(self, frame: Any, arrival_ns: int) -> None:
        """Publish a sample of the configured sensor."""
        if not isinstance(frame, ImuSample) or frame.unit != self._unit:
            self.health.events["other frames"] += 1
            return
        sequence = self._follow(frame, arrival_ns)
        self.publish(frame, arrival_ns, sequence)
        if self.rate.sample(arrival_ns):
            self._check_rate()

    def publish(self, sample: ImuSample, arrival_ns: int, sequence: int | None) -> None:
        """Publish a sample; without a device time it counts as measured on arrival, less the latency."""
        self.stream.publish(
            sample, host_ns=arrival_ns, measured_ns=arrival_ns - self.latency_ns, sequence=sequence
        )

    def begin_epoch(self) -> None:
        """Begin an epoch: the unit has started anew."""
        self.stream.start_epoch(RESTARTED)

    def _follow(self, sample: ImuSample, arrival_ns: int) -> int | None:
        """Return the sequence number without wrapping, None where there is none."""
        last_ns, self._arrival_ns = self._arrival_ns, arrival_ns
        # Without a number only silence shows a restart, after which the heading has another zero.
        if self._index is None or sample.index is None:
            if last_ns is not None and arrival_ns - last_ns > RESTART_NS:
                self.begin_epoch()
            return None
        step = self._index.step(sample.index, arrival_ns)
        self.health.gaps += step.lost
        if step.restarted:
            self.begin_epoch()
        return step.index

    def _check_rate(self) -> None:
        # The wrong rate is often the only sign of a wrong setting: some frames are missing, none is wrong.
        measured = self.rate.rate or 0.0
        if abs(measured - self.rate_hz) > RATE_TOLERANCE * self.rate_hz:
            cure = "set `rate_hz`, or the unit's rate and content; a slow line lowers the rate"
            limit = self.rate_hz
            self.health.alarms.set(
                RATE, "the unit's rate is wrong", cure, value=round(measured, 1), limit=limit, unit="Hz"
            )
        else:
            self.health.alarms.clear(RATE)


class XbusImu(Imu[ImuSample | XbusMessage]):
    """An Xsens unit; its sample time maps to the host clock."""

    def __init__(self, config: "XbusConfig", sink: Sink, clock: Clock, *, observe: bool) -> None:
        index = IndexTracker(xbus.INDEX_MODULUS, round(NANOSECONDS / config.rate_hz))
        super().__init__(config, xbus_codec(), "Xbus messages FA FF ...", index, sink, clock, observe=observe)
        self._time = _UnwrappedTime(xbus.TIME_MODULUS)

    async def begin(self, link: SerialLink) -> None:
        """Start the measurement; a unit that measures already ignores it."""
        if not self.observe:
            link.write(xbus.encode_message(xbus.GO_TO_MEASUREMENT))

    async def run(self, link: SerialLink) -> None:
        """Start the measurement again when the unit has fallen silent."""
        while True:
            before = self.health.frames
            await asyncio.sleep(SILENT_S)
            if self.health.frames == before and not self.observe:
                self.health.events["asked to measure"] += 1
                link.write(xbus.encode_message(xbus.GO_TO_MEASUREMENT))

    def restarted(self) -> None:
        """Forget sequence, rate and time."""
        super().restarted()
        self._time.restart()

    def publish(self, sample: ImuSample, arrival_ns: int, sequence: int | None) -> None:
        """Publish a sample with its device time."""
        if sample.device_time is None:
            super().publish(sample, arrival_ns, sequence)
            return
        time_s, back = self._time.step(sample.device_time)
        if back:
            self.begin_epoch()
        self.stream.publish(
            sample, host_ns=arrival_ns, device_time_ns=round(time_s * NANOSECONDS), sequence=sequence
        )

    def handle_frame(self, frame: Any, arrival_ns: int) -> None:
        """Publish a sample; follow errors and restarts."""
        if isinstance(frame, XbusMessage):
            self.health.rejected += frame.message_id == xbus.ERROR
            if frame.message_id == xbus.WAKE_UP:
                self.restarted()
                self.begin_epoch()
        super().handle_frame(frame, arrival_ns)


class _UnwrappedTime:
    """A time that wraps, made to grow; going back by less than half its range is a restart."""

    def __init__(self, modulus: float) -> None:
        self._modulus = modulus
        self._last: float | None = None
        self._base = 0.0

    def restart(self) -> None:
        self._last, self._base = None, 0.0

    def step(self, time_s: float) -> tuple[float, bool]:
        """Return the time without wrapping [s], and whether it has gone back."""
        last, self._last = self._last, time_s
        if last is None or time_s >= last:
            return self._base + time_s, False
        if last - time_s > self._modulus / 2:
            self._base += self._modulus
            return self._base + time_s, False
        self._base = 0.0
        return time_s, True


class Bno08xConfig(ImuConfig):
    """A BNO080 or BNO085 in UART-RVC mode."""

    kind: Literal["bno08x_rvc"] = "bno08x_rvc"
    baud: Baud = 115200
    latency_s: Latency = 0.0017

    def build(
        self, sink: Sink = ignore, clock: Clock = monotonic, *, observe: bool = False
    ) -> Imu[ImuSample]:
        """Build the device; no I/O before its `connect`."""
        index = IndexTracker(bno08x.INDEX_MODULUS, round(NANOSECONDS / self.rate_hz))
        expected = "19-byte RVC frames AA AA ..."
        return Imu(self, bno08x.bno08x_codec(), expected, index, sink, clock, observe=observe)


class XbusConfig(ImuConfig):
    """An Xsens unit that speaks Xbus."""

    kind: Literal["xbus"] = "xbus"
    baud: Baud = 115200

    def build(self, sink: Sink = ignore, clock: Clock = monotonic, *, observe: bool = False) -> XbusImu:
        """Build the device; no I/O before its `connect`."""
        return XbusImu(self, sink, clock, observe=observe)


class QuaternionLineConfig(ImuConfig):
    """The lab's sketch that prints quaternions with two decimals."""

    kind: Literal["quaternion_line"] = "quaternion_line"
    baud: Baud = 9600
    rate_hz: Rate = 9.0
    latency_s: Latency = 0.045

    def build(
        self, sink: Sink = ignore, clock: Clock = monotonic, *, observe: bool = False
    ) -> Imu[ImuSample]:
        """Build the device; no I/O before its `connect`."""
        expected = "lines `Quaternion of IMU 1:w,x,y,z`"
        return Imu(self, quaternion_line_codec(), expected, None, sink, clock, observe=observe)
