"""Sauter FH gauge: seven characters per request, no terminator (FH manual, page 13)."""

import math

from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.parts import SauterPart
from softarm.fakes.plant.state import PlantState
from softarm.fakes.serial.instrument import PORT_FAULTS, Instrument
from softarm.fakes.serial.load_cell import GAUGE_FAULTS, NEWTONS_PER, LoadCell

SAUTER_FAULTS = (
    *PORT_FAULTS,
    *GAUGE_FAULTS,
    Fault("unit", "the operator has chosen another unit, which the gauge does not send",
          parameters={"unit": "kg"}, limits={"unit": ("N", "kg", "lb")}),
    Fault("deaf", "a request is ignored", once=True),
)  # fmt: skip


def sauter_reply(value: float) -> bytes:
    """Encode a reading: '1' for tension or '0' for compression, then six characters."""
    magnitude = 999.99 if math.isinf(value) else min(abs(value), 999.99)
    return b"%b%b" % (b"0" if value < 0 else b"1", f"{magnitude:06.2f}".encode())


class FakeSauter(Instrument):
    """A gauge that answers ``9`` with its reading and tares at ``2``.

    Args:
        part: Its description.
        faults: The board with ``SAUTER_FAULTS``.
        cell: Its load cell.
    """

    def __init__(self, part: SauterPart, faults: FaultBoard, cell: LoadCell) -> None:
        super().__init__(faults, part.baud)
        self._cell = cell

    def next_time(self) -> None:
        """Return no time: the gauge sends nothing without a request."""
        return

    def receive(self, time: float, data: bytes, state: PlantState) -> bytes:  # noqa: ARG002
        """Answer each request among the bytes."""
        replies = b""
        for letter in data:
            if self._cell.is_off() or self.faults.hit("deaf"):
                continue
            if letter == ord("9"):
                chosen = self.faults.hit("unit")
                scale = NEWTONS_PER[str(chosen["unit"])] if chosen else 1.0
                replies += sauter_reply(self._cell.pull(state) / scale)
            elif letter == ord("2"):
                self._cell.press_zero(state)
        return replies
