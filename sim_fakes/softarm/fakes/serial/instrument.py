"""What a serial instrument is to the port it hangs on: bytes out at times, bytes in, power."""

from typing import Protocol

from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.plant.state import PlantState

BITS_PER_BYTE = 10

PORT_FAULTS = (
    Fault("unplug", "the device is gone; a new one appears behind the same link when cleared"),
    Fault("silence", "the line is up, but the device sends nothing"),
    Fault("garbage", "random bytes between frames", True, {"size": 11}, {"size": (1, 4096)}),
    Fault("bit_flip", "single bits are inverted", parameters={"per_byte": 0.01}, limits={"per_byte": (0, 1)}),
    Fault("byte_loss", "single bytes are lost", parameters={"per_byte": 0.01}, limits={"per_byte": (0, 1)}),
    Fault("torn_frame", "a frame stops half way", once=True),
    Fault("stall", "the line stops in mid-frame and continues later", True, {"seconds": 0.2}),
)


class Instrument(Protocol):
    """A serial instrument, a function of time and the snapshot it sees, with its own memory.

    It knows no clock, no file descriptor and no baud pacing.
    """

    faults: FaultBoard

    @property
    def baud(self) -> int:
        """Speed of its line [bit/s]."""

    @property
    def checks_baud(self) -> bool:
        """Whether a host at another speed reads rubbish; native USB devices do not care."""

    @property
    def resets_on_open(self) -> bool:
        """Whether a host that opens the port resets it, as DTR does an Arduino Uno."""

    def power_on(self, time: float) -> bytes:
        """Start at ``time`` [s]; return what it says at once."""

    def next_time(self) -> float | None:
        """Give the time of the next output of its own [s]; None while it only answers."""

    def update(self, time: float, state: PlantState) -> bytes:
        """Give what it sends at ``time`` [s] of its own accord."""

    def receive(self, time: float, data: bytes, state: PlantState) -> bytes:
        """Take bytes from the host at ``time`` [s] and give the answer."""
