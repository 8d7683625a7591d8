"""Force gauges: what all share, and those that stream."""

from typing import Annotated, Any, Literal

from pydantic import Field

from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.framing import Codec
from softarm.drivers.gauges.force import ForceScale, GaugeForce
from softarm.drivers.gauges.line import line_gauge_codec
from softarm.drivers.gauges.lutron import lutron_codec
from softarm.drivers.gauges.sample import GaugeSample
from softarm.drivers.reading import Sink, ignore
from softarm.drivers.serial_device import FrameT, SerialDevice
from softarm.drivers.serial_link import Baud, Latency, SerialConfig

UnitName = Literal["N", "mN", "kN", "g", "kg", "tf", "lb", "klb", "oz"]
OVER_RANGE = "over_range"
UNIT = "unit"


class GaugeConfig(SerialConfig):
    """Settings of any force gauge.

    Attributes:
        pull_sign: Sign of a pull on the display.
        unit: Unit of the display, where the instrument does not send it.
        tare_n: Pull that counts as zero at the start [N].
    """

    pull_sign: Literal[-1, 1] = 1
    unit: UnitName | None = None
    tare_n: Annotated[float, Field(allow_inf_nan=False)] = 0.0


class ForceGauge(SerialDevice[FrameT, GaugeForce]):
    """A force gauge; readings are `GaugeForce`, pull positive.

    Args:
        config: Its settings.
        codec: Parser of its bytes.
        expected: What its frames look like.
        sink: Receives each reading.
        clock: Host monotonic time.
        observe: Send nothing that changes a setting.
    """

    def __init__(
        self,
        config: GaugeConfig,
        codec: Codec[FrameT],
        expected: str,
        sink: Sink = ignore,
        clock: Clock = monotonic,
        *,
        observe: bool = False,
    ) -> None:
        super().__init__(config, codec, expected, sink, clock, observe=observe)
        self.config = config
        self.scale = ForceScale(config.pull_sign, config.unit, config.tare_n)

    def restarted(self) -> None:
        """Forget the last sample."""
        self.scale.restart()

    def publish(
        self, sample: GaugeSample, arrival_ns: int, *, unit: str | None = None, trusted: bool = True
    ) -> None:
        """Pass a sample on as a reading.

        Args:
            sample: What the instrument sent.
            arrival_ns: Host monotonic time of arrival [ns].
            unit: Its unit, where the sample lacks it and the instrument reported it otherwise.
            trusted: Whether the instrument's settings are known to be right.
        """
        judged = self.scale.judge(sample, unit)
        for event in judged.events:
            self.health.events[event] += 1
        self._alarm(sample, judged.force)
        flags = judged.flags if trusted else (*judged.flags, "settings")
        self.stream.publish(
            judged.force,
            host_ns=arrival_ns,
            measured_ns=arrival_ns - self.latency_ns,
            valid=judged.valid and trusted,
            flags=flags,
        )

    def _alarm(self, sample: GaugeSample, force: GaugeForce) -> None:
        alarms = self.health.alarms
        if sample.over_range:
            self.health.events[OVER_RANGE] += OVER_RANGE not in alarms
            alarms.set(OVER_RANGE, "the load is beyond the range of the gauge", "remove the load")
        else:
            alarms.clear(OVER_RANGE)
        if not force.unit:
            alarms.set(UNIT, "the gauge does not send its unit", "let it send the unit, or set `unit`")
        else:
            alarms.clear(UNIT)


class StreamingGauge(ForceGauge[GaugeSample]):
    """A gauge that sends readings of its own accord."""

    def handle_frame(self, frame: GaugeSample, arrival_ns: int) -> None:
        """Publish the main display; others are counted."""
        if frame.display != 1:
            self.health.rejected += 1
            return
        self.publish(frame, arrival_ns)


class LutronConfig(GaugeConfig):
    """A Lutron gauge with the 16-digit stream.

    Attributes:
        latency_s: A frame of 16 characters at 9600 baud takes 17 ms [s].
    """

    kind: Literal["lutron"] = "lutron"
    baud: Baud = 9600
    latency_s: Latency = 0.017

    def build(
        self, sink: Sink = ignore, clock: Clock = monotonic, *, observe: bool = False
    ) -> StreamingGauge:
        """Build the device; no I/O before its `connect`."""
        expected = "16-character Lutron frames, 02 '4' ... 0D"
        return StreamingGauge(self, lutron_codec(), expected, sink, clock, observe=observe)


class LineGaugeConfig(GaugeConfig):
    """A board that prints one reading per line.

    Attributes:
        separator: What separates columns; None if a line is one reading.
        column: Which column is the reading, counted from 0.
    """

    kind: Literal["line_gauge"] = "line_gauge"
    baud: Baud = 115200
    separator: Annotated[str, Field(min_length=1, max_length=4)] | None = None
    column: Annotated[int, Field(ge=0, le=63)] = 0

    def build(
        self, sink: Sink = ignore, clock: Clock = monotonic, *, observe: bool = False
    ) -> StreamingGauge:
        """Build the device; no I/O before its `connect`."""
        codec: Any = line_gauge_codec(self.separator, self.column)
        return StreamingGauge(self, codec, "lines with one number", sink, clock, observe=observe)
