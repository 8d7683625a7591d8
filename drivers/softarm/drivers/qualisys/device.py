"""Motion capture with Qualisys Track Manager; readings are `MotionFrame`."""

import asyncio
from typing import Literal

from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.device import Device
from softarm.drivers.errors import ConnectionLost
from softarm.drivers.qualisys.connection import PORT_CURE, QtmConnection
from softarm.drivers.qualisys.poses import MotionFrame
from softarm.drivers.qualisys.publisher import MotionPublisher, QtmConfig
from softarm.drivers.qualisys.session import QtmSession
from softarm.drivers.reading import Sink, ignore
from softarm.drivers.stream import ReadingStream
from softarm.drivers.supervisor import Timing


class QualisysConfig(QtmConfig):
    """A host that runs Qualisys Track Manager."""

    kind: Literal["qualisys"] = "qualisys"

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
    """The motion capture."""

    def __init__(self, config: QualisysConfig, sink: Sink = ignore, clock: Clock = monotonic) -> None:
        timing = Timing(config.stale_after_s, config.lost_after_s, identify_s=10 * config.answer_s)
        super().__init__(config.name, config.source, timing=timing, clock=clock)
        self._config = config
        self.stream: ReadingStream[MotionFrame] = self.reading_stream(sink)
        self._publisher = MotionPublisher(config, self.stream, self.health)

    async def open(self) -> QtmSession:
        """Open the connection."""
        host, port = self._config.host, self._config.port
        loop = asyncio.get_running_loop()
        try:
            _, connection = await loop.create_connection(
                lambda: QtmConnection(self.name, self.clock), host, port
            )
        except OSError as error:
            raise ConnectionLost(
                self.name, f"{host}:{port} cannot be reached: {error}", f"start QTM, {PORT_CURE}"
            ) from error
        return QtmSession(self._config, connection, self._publisher, self.health, self.clock)
