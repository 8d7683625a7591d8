"""The lab's Arduino with BendLabs sensors: lines of angles in degrees."""

import math

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.parts import BendPart
from softarm.fakes.plant.state import Plant, PlantState
from softarm.fakes.serial.instrument import PORT_FAULTS, Instrument
from softarm.fakes.signals import SignalFilter

DEAD_ZONE_DEGREES = 0.5
CUTOFF_HZ, FILTER_HZ = 20.0, 100.0
MALFORMED = {
    "nan": b"nan,0.00,1.00,2.00,3.00,4.00",
    "inf": b"inf,0.00,1.00,2.00,3.00,4.00",
    "seven": b"1.00,2.00,3.00,4.00,5.00,6.00,7.00",
    "overflow": b"ovf,0.00,1.00,2.00,3.00,4.00",
    "huge": b"1e30,0.00,1.00,2.00,3.00,4.00",
    "long": b"1.00," * 200,
    "empty": b"",
}


def bend_faults(sensors: int) -> tuple[Fault, ...]:
    """List what can go wrong."""
    sensor = {"sensor": (1, sensors)}
    return (
        *PORT_FAULTS,
        Fault(
            "dropout", "one sensor repeats its last pair silently", parameters={"sensor": 1}, limits=sensor
        ),
        Fault("reboot", "the microcontroller resets: silence, boot text", once=True),
        Fault(
            "cannot_connect",
            "reboots, reports that a sensor is missing and prints 0.00 for it",
            parameters={"sensor": 2},
            limits=sensor,
        ),
        Fault(
            "malformed",
            "a line that is not what it should be",
            once=True,
            parameters={"kind": "nan"},
            limits={"kind": tuple(MALFORMED)},
        ),
    )


def biquad(cutoff: float, rate: float) -> tuple[Floats, Floats]:
    """Return numerator and denominator of a second-order Butterworth low-pass (bilinear transform)."""
    k = math.tan(math.pi * cutoff / rate)
    norm = 1.0 / (1.0 + math.sqrt(2.0) * k + k * k)
    numerator = np.array([k * k, 2.0 * k * k, k * k]) * norm
    return numerator, np.array([2.0 * (k * k - 1.0), 1.0 - math.sqrt(2.0) * k + k * k]) * norm


class BendBoard(Instrument):
    """Prints ``x1,y1,x2,y2,...``; sensor 1 is the most distal one.

    Each angle passes the library's low-pass and then its dead zone, which repeats the last output until the
    angle has moved by more than half a degree.

    Args:
        part: Its description; its speed paces the line, but that of the host does not matter (native USB).
        faults: The board with ``bend_faults``.
        plant: The arm.
        seed: Seed of the noise.
        signal_filter: What is concealed in a ``bend``, given for each segment as ``bend_<section below it>``.
    """

    checks_baud = False

    def __init__(
        self, part: BendPart, faults: FaultBoard, plant: Plant, seed: int, signal_filter: SignalFilter
    ) -> None:
        super().__init__(faults, part.baud, part.rate_hz)
        self.resets_on_open = part.resets_on_open
        self._signal_filter = signal_filter
        self._channels = [f"bend_{section}" for section in plant.sections[1:]]
        self._segments = [plant.segments.index(name) if name else None for name in part.sensors]
        self._noise = part.noise_rad
        self._boot_time = part.boot_s
        self._random = np.random.default_rng(seed)
        self._filter = biquad(CUTOFF_HZ, FILTER_HZ)
        self._greeted: bool = False
        self._reboot: bool = False
        self._reset()
        faults.listen(self._on_fault)

    def power_on(self, time: float) -> bytes:
        """Boot: nothing for a while."""
        self._reset()
        return super().power_on(time + self._boot_time)

    def update(self, time: float, state: PlantState) -> bytes:
        """Send the line that is due; after a boot its text first."""
        if self.faults.hit("reboot") or self._reboot:
            self.power_on(time)
            return b""
        self._schedule.advance(time)
        text = b"" if self._greeted else self._greeting()
        angles = self._sense(state)
        self._greeted = True
        if malformed := self.faults.hit("malformed"):
            return text + MALFORMED[str(malformed["kind"])] + b"\r\n"
        return text + ",".join(f"{angle:.2f}" for angle in angles).encode() + b"\r\n"

    def _reset(self) -> None:
        count = 2 * len(self._segments)
        self._past_in, self._past_out = np.zeros((2, count)), np.zeros((2, count))
        self._shown = np.zeros(count)
        self._greeted = False
        self._reboot = False

    def _greeting(self) -> bytes:
        missing = self.faults.hit("cannot_connect")
        text = b"BendLabs two-axis sensors\r\n"
        return text + b"cannot connect to sensor %d\r\n" % int(missing["sensor"]) if missing else text

    def _sense(self, state: PlantState) -> Floats:
        """Filter the angles and apply the dead zone [degrees], shape (2 sensors,)."""
        angles = [0.0, 0.0] * len(self._segments)
        for sensor, segment in enumerate(self._segments):
            if segment is not None:
                measured = self._signal_filter(
                    "bend", self._channels[segment], state.time, state.bends[segment]
                )
                angles[2 * sensor : 2 * sensor + 2] = [float(angle) for angle in measured]
        raw = np.degrees(np.array(angles) + self._random.normal(0.0, self._noise, len(angles)))
        numerator, denominator = self._filter
        # The filter starts settled, or each boot would look like an arm that unbends.
        if not self._greeted:
            self._past_in, self._past_out = np.stack([raw, raw]), np.stack([raw, raw])
        smooth = numerator[0] * raw + numerator[1:] @ self._past_in - denominator @ self._past_out
        self._past_in, self._past_out = (
            np.stack([raw, self._past_in[0]]),
            np.stack([smooth, self._past_out[0]]),
        )
        moved = np.abs(smooth - self._shown) > DEAD_ZONE_DEGREES
        for broken in (self.faults.hit("dropout"), self.faults.active("cannot_connect")):
            if broken:
                pair = 2 * int(broken["sensor"]) - 2
                moved[pair : pair + 2] = False
        self._shown = np.where(moved, smooth, self._shown)
        return self._shown

    def _on_fault(self, name: str, active: bool) -> None:  # noqa: ARG002
        self._reboot = self._reboot or name == "cannot_connect"
