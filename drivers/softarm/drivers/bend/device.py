"""BendLabs sensors on the lab's Arduino, in chain order and radians.

The same value again is no sign of a fault: the firmware repeats its output until an axis has moved by half a
degree. The reading counts as fresh with every line.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians
from typing import Annotated, Literal

from pydantic import Field, model_validator

from softarm.drivers.bend.bendlabs import BendLine, BendStatus, bend_codec
from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.reading import Sink, ignore
from softarm.drivers.serial_device import SerialDevice
from softarm.drivers.serial_link import Baud, SerialConfig

Pair = tuple[float, float]
RECALIBRATE = "recalibrate"


@dataclass(frozen=True, slots=True)
class BendAngles:
    """One line of all sensors, ordered from the base to the tip.

    Args:
        angles: Two angles per sensor, less their zero [rad].
        valid: Per sensor, whether the board reaches it. A sensor that falls silent later repeats its last
            angles; that cannot be seen on this line.
    """

    angles: tuple[Pair, ...]
    valid: tuple[bool, ...]


class BendConfig(SerialConfig):
    """A board with BendLabs sensors.

    Attributes:
        sensors: How many sensors a line carries.
        order: Which end of the arm the first sensor of a line is at.
        zero_deg: Angles that count as zero, one pair per sensor from the base on [degree].
    """

    kind: Literal["bendlabs"] = "bendlabs"
    baud: Baud = 115200
    sensors: Annotated[int, Field(ge=1, le=16)] = 3
    order: Literal["distal_first", "base_first"] = "distal_first"
    zero_deg: tuple[Pair, ...] | None = None

    @model_validator(mode="after")
    def _pairs(self) -> "BendConfig":
        if self.zero_deg is not None and len(self.zero_deg) != self.sensors:
            raise ValueError(f"zero_deg has {len(self.zero_deg)} pairs for {self.sensors} sensors")
        return self

    def build(self, sink: Sink = ignore, clock: Clock = monotonic, *, observe: bool = False) -> "BendSensors":
        """Build the device; no I/O before its `connect`."""
        return BendSensors(self, sink, clock, observe=observe)


class BendSensors(SerialDevice[BendLine | BendStatus, BendAngles]):
    """The board; readings are `BendAngles`.

    Args:
        config: Its settings.
        sink: Receives each reading.
        clock: Host monotonic time.
        observe: Has no effect: the board only sends.
    """

    def __init__(
        self, config: BendConfig, sink: Sink = ignore, clock: Clock = monotonic, *, observe: bool = False
    ) -> None:
        codec = bend_codec(config.sensors)
        expected = f"lines of {2 * config.sensors} angles such as 1.25,-0.50,..."
        super().__init__(config, codec, expected, sink, clock, observe=observe)
        self._sensors = config.sensors
        self._distal_first = config.order == "distal_first"
        self._zero = tuple(
            (radians(a), radians(b)) for a, b in config.zero_deg or ((0.0, 0.0),) * config.sensors
        )
        self._absent: set[int] = set()
        self._talked = False
        self._recalibrate = False

    def restarted(self) -> None:
        """Flag readings `recalibrate` from now on if the sensors may have lost power."""
        self._recalibrate = self._recalibrate or self._talked
        self._talked = False
        self._absent.clear()

    def handle_frame(self, frame: BendLine | BendStatus, arrival_ns: int) -> None:
        """Publish a line of angles; follow a line of text."""
        if isinstance(frame, BendStatus):
            self._on_status(frame)
        else:
            self._publish(frame, arrival_ns)

    def _on_status(self, status: BendStatus) -> None:
        """Follow the messages of the sketch when it starts."""
        self.health.facts["status"] = status.text
        self.health.events["status"] += 1
        # The sketch writes text only when it starts: after angles it has started anew.
        if self._talked:
            self.stream.start_epoch("board restarted")
            self.restarted()
            self.health.alarms.clear("absent")
        if status.absent_sensor is not None:
            self._absent.add(status.absent_sensor)
            named = ", ".join(str(sensor) for sensor in sorted(self._absent))
            self.health.alarms.set(
                "absent", f"the board cannot reach sensor {named}", "check its plug, restart"
            )

    def _publish(self, line: BendLine, arrival_ns: int) -> None:
        self._talked = True
        gross = _pairs(line.angles_deg)
        valid = tuple(number not in self._absent for number in range(1, self._sensors + 1))
        if self._distal_first:
            gross, valid = gross[::-1], valid[::-1]
        angles = tuple((a - za, b - zb) for (a, b), (za, zb) in zip(gross, self._zero, strict=True))
        absent = tuple(f"absent:{number}" for number in sorted(self._absent))
        self.stream.publish(
            BendAngles(angles, valid),
            host_ns=arrival_ns,
            measured_ns=arrival_ns - self.latency_ns,
            valid=any(valid),
            flags=(*absent, RECALIBRATE) if self._recalibrate else absent,
        )


def _pairs(angles_deg: Sequence[float]) -> tuple[Pair, ...]:
    values = [radians(angle) for angle in angles_deg]
    return tuple(zip(values[::2], values[1::2], strict=True))
