"""What a serial instrument is to the port it hangs on: bytes out at times, bytes in, power."""

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


class SendSchedule:
    """Times at a fixed rate [Hz], without drift; what is more than a second late is left out."""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self.next = 0.0

    def start(self, time: float) -> None:
        """Set the next beat to ``time`` [s]."""
        self.next = time

    def advance(self, time: float) -> None:
        """Pass the beat that is due at ``time`` [s]."""
        self.next += 1.0 / self.rate
        if time - self.next > 1.0:
            self.next = time  # after a stall of the host, or it would send a burst that no device sends


class Instrument:
    """A serial instrument, a function of time and the snapshot it sees, with its own memory.

    It has no clock, no file descriptor and no baud pacing. By default it speaks at a steady rate from
    power-on and ignores the host.

    Args:
        faults: Its board.
        baud: Speed of its line [bit/s].
        rate: How often it speaks of its own accord [Hz].
    """

    checks_baud = True
    """Whether a host at another speed reads rubbish; native USB devices do not care."""
    resets_on_open = False
    """Whether a host that opens the port resets it, as DTR does an Arduino Uno."""

    def __init__(self, faults: FaultBoard, baud: int, rate: float = 1.0) -> None:
        self.faults = faults
        self.baud = baud
        self._schedule = SendSchedule(rate)

    def power_on(self, time: float) -> bytes:
        """Start at ``time`` [s]; return what it sends at once."""
        self._schedule.start(time)
        return b""

    def next_time(self) -> float | None:
        """Return the time of the next output of its own [s]; None while it only answers."""
        return self._schedule.next

    def update(self, time: float, state: PlantState) -> bytes:  # noqa: ARG002
        """Return what it sends at ``time`` [s] without a request."""
        return b""

    def receive(self, time: float, data: bytes, state: PlantState) -> bytes:  # noqa: ARG002
        """Handle bytes from the host at ``time`` [s] and return the answer."""
        return b""


def corrupted(frame: bytes, faults: FaultBoard) -> bytes:
    """Return a frame as the faults ``bad_checksum`` and ``byte_slip`` leave it."""
    if faults.hit("bad_checksum"):
        frame = frame[:-1] + bytes([frame[-1] ^ 0x55])
    return frame[:2] + frame[3:] if faults.hit("byte_slip") else frame
