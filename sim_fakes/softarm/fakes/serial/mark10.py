"""Mark-10 gauge with GCL2 commands (manuals of Series 4 and 5)."""

import math
import re

from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.parts import Mark10Part
from softarm.fakes.plant.state import PlantState
from softarm.fakes.serial.instrument import PORT_FAULTS, Instrument, SendSchedule
from softarm.fakes.serial.load_cell import GAUGE_FAULTS, NEWTONS_PER, LoadCell

UNITS = {
    "N": ("N", 3, "N"), "KN": ("kN", 6, "kN"), "MN": ("mN", 0, "mN"), "LB": ("lbF", 4, "lb"),
    "OZ": ("ozF", 2, "oz"), "KG": ("kgF", 4, "kg"), "G": ("gF", 1, "g"),
}  # fmt: skip
LIST_UNITS = {"N": "N", "KN": "KN", "MN": "MN", "LB": "LBF", "OZ": "OZF", "KG": "KGF", "G": "GF"}
LONGEST_COMMAND = 64
ILLEGAL, INVALID, TOO_LARGE = b"*10\r\n", b"*12\r\n", b"*22\r\n"
AUTO_RATES = (0, 1, 2, 5, 10, 25, 50, 125, 250)

MARK10_FAULTS = (
    *PORT_FAULTS,
    *GAUGE_FAULTS,
    Fault("unit", "the operator has chosen another unit", False, {"unit": "LB"}, {"unit": tuple(UNITS)}),
    Fault("no_unit", "readings come without their unit"),
    Fault("inverted", "the menu has inverted the polarity"),
    Fault("refuses", "a command is answered with *10", once=True),
)  # fmt: skip


class FakeMark10(Instrument):
    """A gauge that answers commands and streams on command; tension reads negative.

    Args:
        part: Its description.
        faults: The board with ``MARK10_FAULTS``.
        cell: Its load cell.
    """

    def __init__(self, part: Mark10Part, faults: FaultBoard, cell: LoadCell) -> None:
        super().__init__(faults, part.baud)
        self._cell = cell
        self._unit: str = part.unit
        self._peaks = {"T": 0.0, "C": 0.0}
        self._filters = {"C": 3, "P": 1}
        self._auto_off = 5
        self._buffer = bytearray()
        self._streams = False

    def power_on(self, time: float) -> bytes:  # noqa: ARG002
        """Start silent, waiting for commands."""
        self._buffer.clear()
        self._streams = False
        return b""

    def next_time(self) -> float | None:
        """Return the time of the next reading of the continuous output [s]."""
        return self._schedule.next if self._streams else None

    def update(self, time: float, state: PlantState) -> bytes:
        """Send the reading that is due."""
        self._schedule.advance(time)
        return b"" if self._cell.is_off() else self._reading(state)

    def receive(self, time: float, data: bytes, state: PlantState) -> bytes:
        """Handle command bytes and return the replies to the commands that they complete."""
        self._buffer += data.replace(b"\n", b"")  # commands end with CR or CRLF
        replies = b""
        while (end := self._buffer.find(b"\r")) >= 0:
            command = bytes(self._buffer[:end])
            del self._buffer[: end + 1]
            if not self._cell.is_off():
                replies += self._answer(time, command.decode("latin-1").strip().upper(), state)
        del self._buffer[:-LONGEST_COMMAND]
        return replies

    def _answer(self, time: float, command: str, state: PlantState) -> bytes:
        if not command:
            return b""
        if self.faults.hit("refuses"):
            return ILLEGAL
        if command in ("?", "?C", "?A", "?ET"):
            return self._reading(state)
        if command in ("?PT", "?PC"):
            return self._number(self._peaks[command[-1]])
        if command in UNITS:
            self._unit = command
        elif command in ("Z", "CLR"):
            self._clear(command, state)
        elif command == "LIST":
            return self._list().encode() + b"\r\n"
        elif command in ("RN", "RM", "RV", "RS"):
            return {"RN": b"fake", "RM": b"M5-012", "RV": b"V1.00", "RS": b"0000001"}[command] + b"\r\n"
        elif command not in ("CUR", "PT", "PC", "SAVE", "CLRMEM"):
            return self._set(time, command)
        return b""

    def _set(self, time: float, command: str) -> bytes:
        """Serve the commands that carry a number."""
        match = re.fullmatch(r"(FLTC|FLTP|AOUT|AOFF)(\d+)", command)
        if match is None:
            return INVALID if command.startswith(("FLT", "AOUT", "AOFF", "?")) else ILLEGAL
        verb, number = match[1], int(match[2])
        if verb.startswith("FLT"):
            if number > 10:
                return TOO_LARGE
            self._filters[verb[-1]] = number
        elif verb == "AOFF":
            self._auto_off = number
        elif number not in AUTO_RATES:
            return INVALID
        else:
            self._streams = number > 0
            self._schedule = SendSchedule(number or 1.0)
            self._schedule.start(time)
        return b""

    def _clear(self, command: str, state: PlantState) -> None:
        self._peaks = {"T": 0.0, "C": 0.0}
        if command == "Z":
            self._cell.press_zero(state)

    def _list(self) -> str:
        unit = LIST_UNITS[self._chosen_unit()]
        output = "NUM" if self.faults.active("no_unit") else "FULL"
        polarity = "INV" if self.faults.active("inverted") else "POL"
        auto = f"AOUT{int(self._schedule.rate) if self._streams else 0:02d}"
        filters = f"FLTC{2 ** self._filters['C']};FLTP{2 ** self._filters['P']}"
        return f"V1.00;{unit};CUR;{filters};{auto};AOFF{self._auto_off};{output};MIT;{polarity};B0"

    def _chosen_unit(self) -> str:
        chosen = self.faults.active("unit")
        return str(chosen["unit"]) if chosen else self._unit

    def _reading(self, state: PlantState) -> bytes:
        pull = self._cell.pull(state)
        self._peaks["T"] = min(self._peaks["T"], -pull)
        self._peaks["C"] = max(self._peaks["C"], -pull)
        return self._number(-pull)

    def _number(self, newtons: float) -> bytes:
        """Write a force, tension negative, in the unit that is set; dashes when out of range."""
        self.faults.hit("unit")
        word, decimals, unit = UNITS[self._chosen_unit()]
        signed = -newtons if self.faults.hit("inverted") else newtons
        value = round(signed / NEWTONS_PER[unit], decimals) + 0.0 if math.isfinite(signed) else None
        number = "----" if value is None else f"{value:.{decimals}f}"
        return f"{number}\r\n".encode() if self.faults.hit("no_unit") else f"{number} {word}\r\n".encode()
