"""The lab's sketch with BNO055 sensors: ``Quaternion of IMU 1:w,x,y,z``."""

from collections.abc import Sequence

from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.parts import QuaternionLinePart
from softarm.fakes.plant.state import PlantState
from softarm.fakes.serial.attitude import Attitude
from softarm.fakes.serial.instrument import PORT_FAULTS, Instrument

MALFORMED = {
    "three": b"Quaternion of IMU 1:0.50,0.50,0.50",
    "zero": b"Quaternion of IMU 1:0.00,0.00,0.00,0.00",
    "nan": b"Quaternion of IMU 1:nan,0.00,0.00,1.00",
    "text": b"Ooops, no BNO055 detected ... Check your wiring or I2C ADDR!",
    "empty": b"",
}

QUATERNION_LINE_FAULTS = (
    *PORT_FAULTS,
    Fault(
        "malformed", "a line that is not a quaternion", True, {"kind": "three"}, {"kind": tuple(MALFORMED)}
    ),
    Fault("reset", "the sketch restarts: a second of silence, heading 0", once=True),
)


class QuaternionLine(Instrument):
    """Prints one line per sensor, with two decimals, ``rate_hz`` times per second.

    Args:
        part: Its description.
        faults: The board with ``QUATERNION_LINE_FAULTS``.
        sections: Index of the rigid section that carries each sensor, sensor 1 first.
        seed: Seed of the noise.
    """

    def __init__(
        self, part: QuaternionLinePart, faults: FaultBoard, sections: Sequence[int], seed: int
    ) -> None:
        super().__init__(faults, part.baud, part.rate_hz)
        self._attitudes = [Attitude(part, section, seed + k) for k, section in enumerate(sections)]

    def power_on(self, time: float) -> bytes:
        """Start with heading 0."""
        for attitude in self._attitudes:
            attitude.reset()
        return super().power_on(time)

    def update(self, time: float, state: PlantState) -> bytes:
        """Send the lines that are due."""
        if self.faults.hit("reset"):
            self.power_on(time + 1.0)
            return b""
        self._schedule.advance(time)
        if malformed := self.faults.hit("malformed"):
            return MALFORMED[str(malformed["kind"])] + b"\r\n"
        lines = b""
        for number, attitude in enumerate(self._attitudes, start=1):
            numbers = ",".join(f"{c:.2f}" for c in attitude.orientation(state))
            lines += f"Quaternion of IMU {number}:{numbers}\r\n".encode()
        return lines
