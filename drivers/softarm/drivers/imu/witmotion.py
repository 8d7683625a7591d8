"""WitMotion frames (WT901 datasheet): `55 type` and four signed words, sum; types 0x50 to 0x5A.

One sample is spread over several frames. They come in rising order of type, so a sample is complete with the
orientation frame (0x59 quaternion, or 0x53 angles where no quaternion is sent); acceleration belongs to the
sample when its frame came since the last one.
"""

import struct
from dataclasses import dataclass, field
from typing import Final

from softarm.drivers.framing import ByteCounts, Decoded, FrameFault, FrameParser, checksum8
from softarm.drivers.imu.sample import ImuSample, Quaternion, normalised, quaternion_from_yaw_pitch_roll

FRAME_LENGTH: Final = 11
ACCELERATION: Final = 0x51
ANGLES: Final = 0x53
QUATERNION: Final = 0x59

RATES: Final = {0.2: 1, 0.5: 2, 1: 3, 2: 4, 5: 5, 10: 6, 20: 7, 50: 8, 100: 9, 125: 0x0A, 200: 0x0B}
"""Register value per output rate [Hz]."""

UNLOCK: Final = bytes.fromhex("ff aa 69 88 b5")
"""Opens the configuration for ten seconds."""

_WORDS: Final = struct.Struct("<4h")


@dataclass(frozen=True, slots=True)
class WitFrame:
    """One frame.

    Args:
        kind: Its type byte, 0x50 to 0x5A.
        words: Its four signed words.
    """

    kind: int
    words: tuple[int, int, int, int]


class WitRule:
    """One frame of eleven bytes."""

    start = b"\x55"

    def length(self, head: bytes) -> int | None:
        """Return 11 if a type follows, else 0."""
        if len(head) < 2:
            return None
        # 0x55 is common within frames, too; the type that follows it rules most of those out.
        return FRAME_LENGTH if 0x50 <= head[1] <= 0x5A else 0

    def decode(self, frame: bytes) -> WitFrame | FrameFault:
        """Return the frame, or the fault that makes it none."""
        if checksum8(frame[:10]) != frame[10]:
            return FrameFault("checksum", f"sum {checksum8(frame[:10]):#04x}, frame says {frame[10]:#04x}")
        return WitFrame(frame[1], _WORDS.unpack_from(frame, 2))


@dataclass(slots=True)
class WitCodec:
    """Incremental parser that assembles samples from frames.

    Args:
        prefer: The frame that completes a sample, `QUATERNION` or `ANGLES`.
    """

    prefer: int = QUATERNION
    frames: FrameParser[WitFrame] = field(default_factory=lambda: FrameParser(WitRule(), head=2))
    kinds: dict[int, int] = field(default_factory=dict)
    _acceleration: tuple[float, float, float] | None = None

    @property
    def counts(self) -> ByteCounts:
        """Bytes since the start."""
        return self.frames.counts

    def reset(self) -> None:
        """Forget a partial frame and a partial sample."""
        self.frames.reset()
        self._acceleration = None

    def feed(self, data: bytes) -> Decoded[ImuSample]:
        """Decode the next bytes and return the samples and faults that they complete."""
        frames = self.frames.feed(data)
        decoded: Decoded[ImuSample] = Decoded([], frames.faults)
        for frame in frames.frames:
            self.kinds[frame.kind] = self.kinds.get(frame.kind, 0) + 1
            if frame.kind == ACCELERATION:
                self._acceleration = _acceleration(frame.words)
            elif frame.kind == self.prefer:
                self._finish(frame, decoded)
        return decoded

    def _finish(self, frame: WitFrame, decoded: Decoded[ImuSample]) -> None:
        quaternion = _quaternion(frame)
        if quaternion is None:
            decoded.faults.append(FrameFault("range", "the quaternion is not of unit length"))
        else:
            decoded.frames.append(ImuSample(quaternion, acceleration=self._acceleration))
        self._acceleration = None


def configuration(register: int, value: int) -> bytes:
    """Return the command that writes `value` (16 bit) to `register`."""
    return bytes([0xFF, 0xAA, register, value & 0xFF, value >> 8])


def content_mask(kinds: set[int]) -> int:
    """Return the content register (0x02) for a set of frame types: bit n requests type 0x50 + n."""
    return sum(1 << (kind - 0x50) for kind in kinds)


def _acceleration(words: tuple[int, int, int, int]) -> tuple[float, float, float]:
    # The words are fractions of full scale: 16 g here, 1 in a quaternion, 180 degrees in angles.
    scale = 16 * 9.80665 / 32768
    return (words[0] * scale, words[1] * scale, words[2] * scale)


def _quaternion(frame: WitFrame) -> Quaternion | None:
    if frame.kind == QUATERNION:
        w, x, y, z = (word / 32768 for word in frame.words)
        return normalised(w, x, y, z, 0.01)
    roll, pitch, yaw = (word * 180 / 32768 for word in frame.words[:3])
    return quaternion_from_yaw_pitch_roll(yaw, pitch, roll)
