"""Lutron gauge: a stream of 16 characters, output only (FG-6005SD manual, page 29)."""

import math

from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.parts import LutronPart
from softarm.fakes.plant.state import PlantState
from softarm.fakes.serial.instrument import PORT_FAULTS, Instrument
from softarm.fakes.serial.load_cell import GAUGE_FAULTS, NEWTONS_PER, LoadCell

UNITS = {"kg": (b"55", 3), "lb": (b"56", 3), "g": (b"57", 0), "oz": (b"58", 2), "N": (b"59", 2)}

LUTRON_FAULTS = (
    *PORT_FAULTS,
    *GAUGE_FAULTS,
    Fault("unit", "the operator has chosen another unit", False, {"unit": "kg"}, {"unit": tuple(UNITS)}),
    Fault("lower_display", "one frame of the lower display", once=True),
    Fault("parity", "the high bit of some characters is set", once=True),
    Fault("stale_frame", "the delimiters of one frame are missing", once=True),
)


def lutron_frame(value: float, unit: str, display: int = 1) -> bytes:
    """Encode one reading.

    Args:
        value: Reading in ``unit``; infinite for over-range.
        unit: One of ``UNITS``.
        display: 1 for the upper display, 2 for the lower one.
    """
    code, decimals = UNITS[unit]
    digits = 99999999 if math.isinf(value) else round(abs(value) * 10**decimals)
    sign = b"1" if value < 0 and digits else b"0"  # no display shows minus zero
    return b"\x024%d%b%b%d%08d\r" % (display, code, sign, decimals, min(digits, 99999999))


class LutronGauge(Instrument):
    """The stream of a Lutron force gauge.

    Args:
        part: Its description.
        faults: The board with ``LUTRON_FAULTS``.
        cell: Its load cell.
    """

    def __init__(self, part: LutronPart, faults: FaultBoard, cell: LoadCell) -> None:
        super().__init__(faults, part.baud, part.rate_hz)
        self._cell = cell
        self._unit = part.unit

    def update(self, time: float, state: PlantState) -> bytes:
        """Send the reading that is due."""
        self._schedule.advance(time)
        if self._cell.is_off():
            return b""
        chosen = self.faults.hit("unit")
        unit = str(chosen["unit"]) if chosen else self._unit
        display = 2 if self.faults.hit("lower_display") else 1
        frame = lutron_frame(self._cell.pull(state) / NEWTONS_PER[unit], unit, display)
        if self.faults.hit("parity"):
            frame = bytes(byte | 0x80 if k % 3 == 0 else byte for k, byte in enumerate(frame))
        if self.faults.hit("stale_frame"):
            frame = frame[1:-1]
        return frame
