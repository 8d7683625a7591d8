"""Motion capture with Qualisys Track Manager; readings are `MotionFrame`."""

import asyncio
from typing import Annotated, Literal

from pydantic import Field, field_validator

from softarm.drivers.clock import NANOSECONDS, Clock, monotonic
from softarm.drivers.config import DriverConfig, Seconds
from softarm.drivers.device import Device
from softarm.drivers.errors import ConnectionLost
from softarm.drivers.qualisys.connection import PORT_CURE, Connection
from softarm.drivers.qualisys.poses import MotionFrame
from softarm.drivers.qualisys.publisher import MotionPublisher
from softarm.drivers.qualisys.session import QtmSession, SessionOptions
from softarm.drivers.reading import Sink, ignore
from softarm.drivers.stream import ReadingStream
from softarm.drivers.supervisor import Timing


class QualisysConfig(DriverConfig):
    """A host that runs Qualisys Track Manager.

    Attributes:
        host: Its address.
        port: Its little-endian port.
        component: What is streamed; `6D` leaves no room for a wrong convention of angles.
        bodies: Names of bodies in QTM, to names here; others are left out. All, as they are named, when
            empty.
        divisor: Every so many frames of the cameras.
        latency_s: From the exposure to the arrival of its frame, where that is known [s].
        answer_s: Time for an answer [s].
        heartbeat_s: Silence after which QTM is asked for its state [s].
        body_lost_after_s: Time after which a lost body is an alarm [s].
    """

    kind: Literal["qualisys"] = "qualisys"
    host: Annotated[str, Field(min_length=1)]
    port: Annotated[int, Field(ge=1, le=65535)] = 22223
    component: Literal["6D", "6DRes", "6DEuler", "6DEulerRes"] = "6D"
    bodies: dict[str, str] = Field(default_factory=dict)
    divisor: Annotated[int, Field(ge=1, le=1000)] = 1
    latency_s: Annotated[float, Field(ge=0, le=1)] = 0.0
    answer_s: Seconds = 1.0
    heartbeat_s: Seconds = 1.0
    body_lost_after_s: Seconds = 0.5

    @field_validator("bodies")
    @classmethod
    def _once(cls, bodies: dict[str, str]) -> dict[str, str]:
        names = list(bodies.values())
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"two bodies of QTM are mapped to {', '.join(twice)}")
        return bodies

    def address(self) -> str:
        """Return the address as a URL."""
        return f"qtm+tcp://{self.host}:{self.port}"

    def build(
        self,
        sink: Sink = ignore,
        clock: Clock = monotonic,
        *,
        observe: bool = False,  # noqa: ARG002
    ) -> "MotionCapture":
        """Build the device; no I/O before its `connect`. It never changes anything in QTM."""
        return MotionCapture(self, sink, clock)


class MotionCapture(Device):
    """The motion capture.

    Args:
        config: Its settings.
        sink: Takes each reading.
        clock: Host monotonic time.
    """

    def __init__(self, config: QualisysConfig, sink: Sink = ignore, clock: Clock = monotonic) -> None:
        timing = Timing(config.stale_after_s, config.lost_after_s, identify_s=10 * config.answer_s)
        super().__init__(config.name, config.source, timing=timing, clock=clock)
        self._address = (config.host, config.port)
        self._options = SessionOptions(config.component, config.divisor, config.answer_s, config.heartbeat_s)
        self.stream: ReadingStream[MotionFrame] = self.reading_stream(sink)
        self._publisher = MotionPublisher(
            self.stream,
            self.health,
            config.bodies,
            config.divisor,
            round(config.latency_s * NANOSECONDS),
            round(config.body_lost_after_s * NANOSECONDS),
        )

    async def open(self) -> QtmSession:
        """Open the connection."""
        host, port = self._address
        loop = asyncio.get_running_loop()
        try:
            _, connection = await loop.create_connection(
                lambda: Connection(self.name, self.clock), host, port
            )
        except OSError as error:
            raise ConnectionLost(
                self.name, f"{host}:{port} cannot be reached: {error}", f"start QTM, {PORT_CURE}"
            ) from error
        return QtmSession(self.name, connection, self._publisher, self.health, self._options, self.clock)
