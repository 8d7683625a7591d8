"""BNO080/085 in UART-RVC mode: 19 bytes at 100 Hz (BNO080 datasheet, page 21)."""

import math
import struct

from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.parts import BnoPart
from softarm.fakes.plant.state import PlantState
from softarm.fakes.rotation import Vector, roll_pitch_yaw
from softarm.fakes.serial.attitude import Attitude
from softarm.fakes.serial.instrument import PORT_FAULTS, Instrument, corrupted

MILLI_G = 9.80665e-3
LAYOUT = struct.Struct("<B6h3x")

CHECKSUM_FAULT = Fault("bad_checksum", "the checksum of a frame is wrong", once=True)
SLIP_FAULT = Fault("byte_slip", "a frame lacks its third byte", once=True)
GAP_FAULT = Fault("index_gap", "the index jumps", True, {"frames": 5}, {"frames": (1, 200)})
RATE_FAULT = Fault("wrong_rate", "another rate", parameters={"hz": 25.0}, limits={"hz": (1, 400)})

BNO_FAULTS = (
    *PORT_FAULTS,
    CHECKSUM_FAULT,
    SLIP_FAULT,
    GAP_FAULT,
    RATE_FAULT,
    Fault("reset", "the sensor resets: silence, index and heading begin at 0", True, {"silent_s": 0.3}),
    Fault("false_header", "while on: index 170 is followed by a byte 0xAA, so AA AA AA AA opens the frame"),
)


def rvc_frame(index: int, degrees: Vector, acceleration: Vector) -> bytes:
    """Encode one frame.

    Args:
        index: Sequence number, 0 to 255.
        degrees: Yaw, pitch, roll [degrees].
        acceleration: In the unit's axes [m/s2].
    """
    angles = [round(100.0 * angle) for angle in degrees]
    milli_g = [max(-32768, min(32767, round(a / MILLI_G))) for a in acceleration]
    body = LAYOUT.pack(index, *angles, *milli_g)
    return b"\xaa\xaa" + body + bytes([sum(body) & 0xFF])


class BnoRvc(Instrument):
    """The stream of a BNO08x.

    Args:
        part: Its description.
        faults: The board with ``BNO_FAULTS``.
        section: Index of the rigid section that carries it.
        seed: Seed of the noise.
    """

    def __init__(self, part: BnoPart, faults: FaultBoard, section: int, seed: int) -> None:
        super().__init__(faults, part.baud, part.rate_hz)
        self._attitude = Attitude(part, section, seed)
        self._rate = part.rate_hz
        self._index = 0

    def power_on(self, time: float) -> bytes:
        """Start with index and heading 0."""
        self._attitude.reset()
        self._index = 0
        return super().power_on(time)

    def update(self, time: float, state: PlantState) -> bytes:
        """Send the frame that is due."""
        if reset := self.faults.hit("reset"):
            self.power_on(time + float(reset["silent_s"]))
            return b""
        changed = self.faults.hit("wrong_rate")
        self._schedule.rate = float(changed["hz"]) if changed else self._rate
        self._schedule.advance(time)
        if gap := self.faults.hit("index_gap"):
            self._index = (self._index + int(gap["frames"])) & 0xFF
        frame = self._frame(state)
        self._index = (self._index + 1) & 0xFF
        return corrupted(frame, self.faults)

    def _frame(self, state: PlantState) -> bytes:
        roll, pitch, yaw = map(math.degrees, roll_pitch_yaw(self._attitude.orientation(state)))
        if self._index == 0xAA and self.faults.hit("false_header"):
            # The low byte of yaw follows the index on the wire; this changes it by less than 2.56 degrees.
            yaw = ((round(100.0 * yaw) & ~0xFF) | 0xAA) / 100.0
            yaw = yaw - 2.56 if yaw > 180.0 else yaw
        return rvc_frame(self._index, (yaw, pitch, roll), self._attitude.acceleration(state))
