"""A WitMotion unit: its output is checked, and set if it is wrong."""

import asyncio
from typing import Literal

from pydantic import model_validator

from softarm.drivers.clock import Clock, monotonic
from softarm.drivers.errors import ProtocolError
from softarm.drivers.imu import witmotion
from softarm.drivers.imu.device import RATE_TOLERANCE, RATE_WINDOW_S, Imu, ImuConfig
from softarm.drivers.imu.sample import ImuSample
from softarm.drivers.imu.witmotion import WitCodec
from softarm.drivers.reading import Sink, ignore
from softarm.drivers.serial_link import Baud, SerialLink

SETTLE_S = 0.6
"""Time over which kinds and rate of frames are counted [s]."""

COMMAND_GAP_S = 0.1
"""Time that the unit needs between commands [s]."""

CONTENT = "content"
_BITS_PER_FRAME = witmotion.FRAME_LENGTH * 10
_REGISTER_CONTENT, _REGISTER_RATE = 0x02, 0x03


class WitConfig(ImuConfig):
    """A WitMotion unit.

    Attributes:
        orientation: Which frame carries it: `quaternion` (0x59) or `angles` (0x53).
        configure: Whether the driver may set rate and content; it never stores them in the unit.
    """

    kind: Literal["witmotion"] = "witmotion"
    baud: Baud = 115200
    orientation: Literal["quaternion", "angles"] = "quaternion"
    configure: bool = True

    @property
    def frames(self) -> set[int]:
        """Kinds of frames that are wanted."""
        wanted = witmotion.QUATERNION if self.orientation == "quaternion" else witmotion.ANGLES
        return {witmotion.ACCELERATION, wanted}

    @model_validator(mode="after")
    def _fits(self) -> "WitConfig":
        if self.rate_hz not in witmotion.RATES:
            offered = ", ".join(f"{rate:g}" for rate in witmotion.RATES)
            raise ValueError(f"rate_hz {self.rate_hz:g} is not one of {offered}")
        # A unit whose line is too slow lowers its rate by itself, without notice.
        bits = self.rate_hz * len(self.frames) * _BITS_PER_FRAME
        if bits > 0.85 * self.baud:
            raise ValueError(
                f"{bits / 1000:.0f} kbit/s do not fit {self.baud} baud: raise baud, lower rate_hz"
            )
        return self

    def build(self, sink: Sink = ignore, clock: Clock = monotonic, *, observe: bool = False) -> "WitImu":
        """Build the device; no I/O before its `connect`."""
        return WitImu(self, sink, clock, observe=observe)


class WitImu(Imu[ImuSample]):
    """The unit.

    Args:
        config: Its settings.
        sink: Receives each reading.
        clock: Host monotonic time.
        observe: Send nothing that changes a setting.
    """

    def __init__(self, config: WitConfig, sink: Sink, clock: Clock, *, observe: bool) -> None:
        prefer = witmotion.QUATERNION if config.orientation == "quaternion" else witmotion.ANGLES
        self._codec = WitCodec(prefer)
        super().__init__(config, self._codec, "11-byte frames 55 5x ...", None, sink, clock, observe=observe)
        self._wanted = config.frames
        self._may_configure = config.configure and not observe

    async def begin(self, link: SerialLink) -> None:
        """Check what the unit sends, and configure it if that is wrong.

        Raises:
            ProtocolError: It sends something else, and may not be set or does not accept the setting. The
                driver tries again: on a bad line it may only look so.
        """
        counts = await self._count_frames(SETTLE_S)
        if not counts or self._as_configured(counts, SETTLE_S):
            return
        if not self._may_configure:
            raise self._refusal(counts, SETTLE_S)
        await self._configure(link)
        counts = await self._count_frames(SETTLE_S)
        if not self._as_configured(counts, SETTLE_S):
            raise self._refusal(counts, SETTLE_S)

    async def run(self, link: SerialLink) -> None:
        """Check again and again: a unit that lost its power for a moment falls back to what it has stored."""
        while True:
            counts = await self._count_frames(RATE_WINDOW_S)
            if self._as_configured(counts, RATE_WINDOW_S):
                self.health.alarms.clear(CONTENT)
            elif counts:
                refusal = self._refusal(counts, RATE_WINDOW_S)
                self.health.alarms.set(CONTENT, refusal.what, refusal.cure)
                if self._may_configure:
                    await self._configure(link)

    async def _count_frames(self, seconds: float) -> dict[int, int]:
        """Count the frames of each kind for a while."""
        self._codec.kinds.clear()
        await asyncio.sleep(seconds)
        return dict(self._codec.kinds)

    async def _configure(self, link: SerialLink) -> None:
        self.health.events["configured"] += 1
        mask = witmotion.content_mask(self._wanted)
        for command in (
            witmotion.UNLOCK,
            witmotion.configuration(_REGISTER_CONTENT, mask),
            witmotion.configuration(_REGISTER_RATE, witmotion.RATES[self.rate_hz]),
        ):
            link.write(command)
            await asyncio.sleep(COMMAND_GAP_S)
        # Not saved in the unit, which may serve other programs: the driver sets it again when it must.

    def _as_configured(self, counts: dict[int, int], seconds: float) -> bool:
        expected = self.rate_hz * seconds
        slack = max(2.0, RATE_TOLERANCE * expected)
        return all(abs(counts.get(kind, 0) - expected) <= slack for kind in self._wanted)

    def _refusal(self, counts: dict[int, int], seconds: float) -> ProtocolError:
        sends = ", ".join(
            f"{kind:#04x} at {count / seconds:.0f} Hz" for kind, count in sorted(counts.items())
        )
        wants = ", ".join(f"{kind:#04x}" for kind in sorted(self._wanted))
        cure = f"set the unit to {wants} at {self.rate_hz:g} Hz, or allow `configure`"
        return ProtocolError(self.name, f"the unit sends {sends}", cure)
