"""Xsens module on Xbus: states, acknowledgements, MTData2."""

import struct

from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.parts import XbusPart
from softarm.fakes.plant.state import PlantState
from softarm.fakes.serial.attitude import Attitude
from softarm.fakes.serial.bno import CHECKSUM_FAULT, GAP_FAULT, SLIP_FAULT
from softarm.fakes.serial.instrument import PORT_FAULTS, Instrument, corrupted

GO_TO_MEASUREMENT, GO_TO_CONFIG, OUTPUT_CONFIGURATION = 0x10, 0x30, 0xC0
DATA, WAKE_UP, ERROR = 0x36, 0x3E, 0x42
TICKS_PER_SECOND = 10_000
WAKE_UP_WAIT = 0.5
INVALID_MESSAGE = 4
LONGEST_COMMAND = 128

XBUS_FAULTS = (
    *PORT_FAULTS,
    CHECKSUM_FAULT,
    SLIP_FAULT,
    GAP_FAULT,
    Fault("error", "an Error message among the data", True, {"code": 30}, {"code": (1, 255)}),
    Fault("config_mode", "the module falls into its configuration state and is silent", once=True),
    Fault("reset", "the module restarts: WakeUp, counter and time begin at 0", once=True),
)


def xbus_message(kind: int, data: bytes = b"") -> bytes:
    """Encode a message."""
    length = bytes([len(data)]) if len(data) < 0xFF else b"\xff" + struct.pack(">H", len(data))
    body = b"\xff" + bytes([kind]) + length + data
    return b"\xfa" + body + bytes([-sum(body) & 0xFF])


class XbusModule(Instrument):
    """A module that measures after ``GoToMeasurement``, or when nobody answers its ``WakeUp``.

    Args:
        part: Its description.
        faults: The board with ``XBUS_FAULTS``.
        section: Index of the rigid section that carries it.
        seed: Seed of the noise.
    """

    def __init__(self, part: XbusPart, faults: FaultBoard, section: int, seed: int) -> None:
        super().__init__(faults, part.baud, part.rate_hz)
        self._attitude = Attitude(part, section, seed, zero_heading=False)
        self._clock = 1.0 + 1e-6 * part.clock_ppm
        self._measuring = True
        self._counter = 0
        self._start = 0.0
        self._buffer = bytearray()

    def power_on(self, time: float) -> bytes:
        """Send WakeUp and measure after a while unless the host answers."""
        self._buffer.clear()
        self._counter, self._start, self._measuring = 0, time, True
        self._schedule.start(time + WAKE_UP_WAIT)
        return xbus_message(WAKE_UP)

    def next_time(self) -> float | None:
        """Return the time of the next data message [s]; None in the configuration state."""
        return self._schedule.next if self._measuring else None

    def update(self, time: float, state: PlantState) -> bytes:
        """Send the data message that is due."""
        if self.faults.hit("reset"):
            return self.power_on(time)
        if self.faults.hit("config_mode"):
            self._measuring = False
            return b""
        self._schedule.advance(time)
        if gap := self.faults.hit("index_gap"):
            self._counter += int(gap["frames"])
        ticks = round((time - self._start) * self._clock * TICKS_PER_SECOND) & 0xFFFFFFFF
        groups = struct.pack(">HBHHBI", 0x1020, 2, self._counter & 0xFFFF, 0x1060, 4, ticks)
        quaternion = struct.pack(">HB4f", 0x2010, 16, *self._attitude.orientation(state))
        message = xbus_message(DATA, groups + quaternion)
        self._counter += 1
        message = corrupted(message, self.faults)
        if error := self.faults.hit("error"):
            message += xbus_message(ERROR, bytes([int(error["code"])]))
        return message

    def receive(self, time: float, data: bytes, state: PlantState) -> bytes:  # noqa: ARG002
        """Handle messages and return their acknowledgements."""
        self._buffer += data
        replies = b""
        while (message := self._next_message()) is not None:
            replies += self._answer(time, *message)
        return replies

    def _next_message(self) -> tuple[int, bytes] | None:
        """Cut the next sound message out of the buffer."""
        while (start := self._buffer.find(b"\xfa")) >= 0:
            del self._buffer[:start]
            if len(self._buffer) < 5:
                return None
            length = self._buffer[3]
            if length > LONGEST_COMMAND:
                del self._buffer[0]
                continue
            if len(self._buffer) < length + 5:
                return None
            message = bytes(self._buffer[: length + 5])
            if sum(message[1:]) & 0xFF == 0:
                del self._buffer[: length + 5]
                return message[2], message[4:-1]
            del self._buffer[0]
        self._buffer.clear()
        return None

    def _answer(self, time: float, kind: int, data: bytes) -> bytes:
        # An acknowledgement has the number of its message plus one.
        if kind == WAKE_UP + 1 or kind == GO_TO_CONFIG:
            self._measuring = False
            return b"" if kind == WAKE_UP + 1 else xbus_message(kind + 1)
        if self._measuring:
            return b""  # a module that measures heeds nothing but GoToConfig
        if kind == GO_TO_MEASUREMENT:
            self._measuring = True
            self._schedule.start(time)
            return xbus_message(kind + 1)
        if kind == OUTPUT_CONFIGURATION:
            return xbus_message(kind + 1, data)
        return xbus_message(ERROR, bytes([INVALID_MESSAGE]))
