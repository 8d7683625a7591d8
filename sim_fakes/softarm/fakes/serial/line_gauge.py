"""A home-made gauge: one number per line in a stated unit, as HX711 boards print it."""

import math

from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.parts import LineGaugePart
from softarm.fakes.plant.state import PlantState
from softarm.fakes.serial.instrument import PORT_FAULTS, Instrument
from softarm.fakes.serial.load_cell import GAUGE_FAULTS, NEWTONS_PER, LoadCell

MALFORMED = {"nan": b"nan", "inf": b"inf", "text": b"HX711 not found", "long": b"1" * 400, "empty": b""}

LINE_GAUGE_FAULTS = (
    *PORT_FAULTS,
    *GAUGE_FAULTS,
    Fault("malformed", "a line that is not a number", once=True, parameters={"kind": "nan"},
          limits={"kind": tuple(MALFORMED)}),
)  # fmt: skip


class LineGauge(Instrument):
    """A stream of lines ``value[ unit]``; an overload reads ``S +``.

    Args:
        part: Its description.
        faults: The board with ``LINE_GAUGE_FAULTS``.
        cell: Its load cell.
    """

    checks_baud = False

    def __init__(self, part: LineGaugePart, faults: FaultBoard, cell: LoadCell) -> None:
        super().__init__(faults, part.baud, part.rate_hz)
        self._part = part
        self._cell = cell

    def update(self, time: float, state: PlantState) -> bytes:
        """Send the line that is due."""
        self._schedule.advance(time)
        if self._cell.is_off():
            return b""
        if malformed := self.faults.hit("malformed"):
            return MALFORMED[str(malformed["kind"])] + b"\r\n"
        value = self._cell.pull(state) / NEWTONS_PER[self._part.unit]
        if math.isinf(value):
            return b"S +\r\n"
        unit = f" {self._part.unit}" if self._part.prints_unit else ""
        return f"{value:.{self._part.decimals}f}{unit}\r\n".encode()

    def receive(self, time: float, data: bytes, state: PlantState) -> bytes:  # noqa: ARG002
        """Handle ``t``, the tare command."""
        if b"t" in data:
            self._cell.press_zero(state)
        return b""
