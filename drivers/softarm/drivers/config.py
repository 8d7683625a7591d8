"""Settings that every device has in the configuration."""

from abc import ABC, abstractmethod
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.device import Device
from softarm.drivers.reading import Sink, ignore

Seconds = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]


class DriverConfig(BaseModel, ABC):
    """Base of the configuration of a device; each driver adds its fields and a literal ``kind``.

    Attributes:
        name: Name of the device in readings, errors and logs.
        kind: Which driver it needs.
        simulated: Whether the peer is a fake; the source of its readings then begins with ``fake+``.
        stale_after_s: Without a valid reading for so long the device counts as degraded [s].
        lost_after_s: Without a sign of life for so long the connection counts as lost [s].
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Name
    kind: str
    simulated: bool = False
    stale_after_s: Seconds = 0.5
    lost_after_s: Seconds | None = None

    @abstractmethod
    def address(self) -> str:
        """Return the address as a URL, such as ``modbus+tcp://192.168.0.100:502``."""

    @property
    def source(self) -> str:
        """The address as readings carry it, with ``fake+`` before that of a fake."""
        return f"fake+{self.address()}" if self.simulated else self.address()

    @abstractmethod
    def build(self, sink: Sink = ignore, clock: Clock = monotonic, *, observe: bool = False) -> Device:
        """Build the device; no I/O before its `connect`.

        Args:
            sink: Receives each reading.
            clock: Host monotonic time.
            observe: Send only what the device needs to answer: nothing moves, no setting changes.
        """
