"""WitMotion module: eleven-byte frames by a content mask, and its configuration (WT901 datasheet)."""

import math
import struct
from collections.abc import Sequence

from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.parts import WitMotionPart
from softarm.fakes.plant.state import PlantState
from softarm.fakes.rotation import roll_pitch_yaw
from softarm.fakes.serial.attitude import Attitude
from softarm.fakes.serial.bno import CHECKSUM_FAULT, SLIP_FAULT
from softarm.fakes.serial.instrument import PORT_FAULTS, Instrument, SendSchedule, corrupted

RATES = {1: 0.2, 2: 0.5, 3: 1, 4: 2, 5: 5, 6: 10, 7: 20, 8: 50, 9: 100, 10: 125, 11: 200}
BAUDS = {1: 4800, 2: 9600, 3: 19200, 4: 38400, 5: 57600, 6: 115200, 7: 230400, 8: 460800, 9: 921600}
SAVE, CONTENT, RATE, BAUD, UNLOCK = 0x00, 0x02, 0x03, 0x04, 0x69
UNLOCK_WORD = 0xB588
UNLOCKED_S = 10.0
DEFAULT_CONTENT, DEFAULT_RATE = 0x1E, 6
FULL = 32768
GRAVITY = 9.80665

WITMOTION_FAULTS = (
    *PORT_FAULTS,
    CHECKSUM_FAULT,
    SLIP_FAULT,
    Fault("forgets", "the configuration falls back to the factory's: 10 Hz, no quaternion", once=True),
    Fault("locked", "configuration commands have no effect"),
    Fault("wrong_content", "no quaternion frames, even if the mask includes them"),
)


def witmotion_frame(kind: int, values: Sequence[int]) -> bytes:
    """Encode a frame of four 16-bit numbers, clipped to their range."""
    clipped = [max(-FULL, min(FULL - 1, value)) for value in values]
    body = struct.pack("<BB4h", 0x55, kind, *clipped)
    return body + bytes([sum(body) & 0xFF])


class WitMotion(Instrument):
    """A module with its registers; commands are ``FF AA register low high``.

    Args:
        part: Its description; its speed is that at power-on.
        faults: The board with ``WITMOTION_FAULTS``.
        section: Index of the rigid section that carries it.
        seed: Seed of the noise.
    """

    def __init__(self, part: WitMotionPart, faults: FaultBoard, section: int, seed: int) -> None:
        super().__init__(faults, part.baud, RATES[DEFAULT_RATE])
        self._attitude = Attitude(part, section, seed, zero_heading=False)
        self._needs_unlock = part.needs_unlock
        self._saved = {CONTENT: DEFAULT_CONTENT, RATE: DEFAULT_RATE}
        self._registers = dict(self._saved)
        self._unlocked_until = -1.0
        self._commands = bytearray()

    def power_on(self, time: float) -> bytes:
        """Start with the saved configuration."""
        self._registers = dict(self._saved)
        self._unlocked_until = -1.0
        self._commands.clear()
        self._apply_rate(time)
        return b""

    def next_time(self) -> float | None:
        """Return the time of the next group of frames [s]; None when the rate is off."""
        return self._schedule.next if self._registers[RATE] in RATES else None

    def update(self, time: float, state: PlantState) -> bytes:
        """Send the group of frames that is due."""
        if self.faults.hit("forgets"):
            self._saved = {CONTENT: DEFAULT_CONTENT, RATE: DEFAULT_RATE}
            self.power_on(time)
        self._schedule.advance(time)
        return corrupted(self._frames(time, state), self.faults)

    def receive(self, time: float, data: bytes, state: PlantState) -> bytes:  # noqa: ARG002
        """Handle configuration commands."""
        self._commands += data
        while (start := self._commands.find(b"\xff\xaa")) >= 0 and len(self._commands) >= start + 5:
            register, value = struct.unpack_from("<BH", self._commands, start + 2)
            del self._commands[: start + 5]
            self._configure(time, register, value)
        del self._commands[:-64]
        return b""

    def _configure(self, time: float, register: int, value: int) -> None:
        if self.faults.hit("locked"):
            return
        if register == UNLOCK and value == UNLOCK_WORD:
            self._unlocked_until = time + UNLOCKED_S
        elif self._needs_unlock and time > self._unlocked_until:
            return
        elif register == SAVE:  # what is not saved is lost with the power
            self._saved = dict(self._registers)
        elif register == BAUD:
            self.baud = BAUDS.get(value, self.baud)
        elif register in (CONTENT, RATE):
            self._registers[register] = value
            self._apply_rate(time)

    def _apply_rate(self, time: float) -> None:
        self._schedule = SendSchedule(RATES.get(self._registers[RATE], 1.0))
        self._schedule.start(time)

    def _frames(self, time: float, state: PlantState) -> bytes:
        content = self._registers[CONTENT]
        if self.faults.hit("wrong_content"):
            content &= ~0x200
        quaternion = self._attitude.orientation(state)
        acceleration = self._attitude.acceleration(state)
        spin = self._attitude.angular_velocity(state)
        groups = {
            0: (0x50, _time_words(time)),
            1: (0x51, [*(round(a / GRAVITY / 16.0 * FULL) for a in acceleration), 2500]),
            2: (0x52, [*(round(math.degrees(w) / 2000.0 * FULL) for w in spin), 0]),
            3: (0x53, [*(round(a / math.pi * FULL) for a in roll_pitch_yaw(quaternion)), 0]),
            4: (0x54, [0, 0, 0, 0]),
            9: (0x59, [round(c * FULL) for c in quaternion]),
        }
        return b"".join(witmotion_frame(*group) for bit, group in groups.items() if content >> bit & 1)


def _time_words(time: float) -> list[int]:
    """Write a module time as year-month, day-hour, minute-second, millisecond."""
    seconds = int(time)
    minute, second, hour = seconds // 60 % 60, seconds % 60, seconds // 3600 % 24
    return [1 << 8 | 24, hour << 8 | 1, second << 8 | minute, round(time % 1.0 * 1000)]
