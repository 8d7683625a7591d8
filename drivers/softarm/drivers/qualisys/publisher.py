"""From the bodies of a data packet to a reading, with names, ages of lost bodies and epochs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, field_validator

from softarm.drivers.clock import NANOSECONDS
from softarm.drivers.config import DriverConfig, Seconds
from softarm.drivers.health import Health
from softarm.drivers.qualisys.bodies import BodyFrame
from softarm.drivers.qualisys.parameters import Parameters
from softarm.drivers.qualisys.poses import BodyPose, MotionFrame, poses
from softarm.drivers.stream import ReadingStream


class QtmConfig(DriverConfig):
    """How a host that runs Qualisys Track Manager is reached and what it streams.

    Attributes:
        host: Its address.
        port: Its little-endian port.
        component: What is streamed; `6D` leaves no room for a wrong convention of angles.
        bodies: Names of bodies in QTM, to names here; others are left out. All, as they are named, when
            empty.
        divisor: Every so many frames of the cameras.
        latency_s: From the exposure to the arrival of its frame, where that is known [s].
        answer_s: Time for an answer [s].
        heartbeat_s: Silence after which the state of QTM is requested [s].
        body_lost_after_s: Time after which a lost body is an alarm [s].
    """

    host: Annotated[str, Field(min_length=1)]
    port: Annotated[int, Field(ge=1, le=65535)] = 22223
    component: Literal["6D", "6DRes", "6DEuler", "6DEulerRes"] = "6D"
    bodies: dict[str, str] = Field(default_factory=dict)
    divisor: Annotated[int, Field(ge=1, le=1000)] = 1
    latency_s: Annotated[float, Field(ge=0, le=1)] = 0.0
    answer_s: Seconds = 1.0
    heartbeat_s: Seconds = 1.0
    body_lost_after_s: Seconds = 0.5

    @field_validator("bodies")
    @classmethod
    def _once(cls, bodies: dict[str, str]) -> dict[str, str]:
        names = list(bodies.values())
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"two bodies of QTM are mapped to {', '.join(twice)}")
        return bodies

    def address(self) -> str:
        """Return the address as a URL."""
        return f"qtm+tcp://{self.host}:{self.port}"


@dataclass(frozen=True, slots=True)
class FrameStep:
    """One frame against the one before.

    Args:
        lost: Frames between the two that never came.
        restarted: The measurement has begun anew.
        frozen: Its time stamp is that of the frame before: nothing new was measured.
    """

    lost: int = 0
    restarted: bool = False
    frozen: bool = False


class Continuity:
    """Follows the frames of one connection.

    A live preview may number all its frames 1, so a repeated frame number means nothing; a repeated time
    stamp does.

    Args:
        stride: Frame numbers from one frame to the next, as requested.
    """

    def __init__(self, stride: int = 1) -> None:
        self._stride = stride
        self._last: tuple[int, int] | None = None

    def step(self, timestamp_us: int, frame: int) -> FrameStep:
        """Compare time stamp [us] and number of a frame with those of the last one."""
        last, self._last = self._last, (timestamp_us, frame)
        if last is None:
            return FrameStep()
        # Both start again with each measurement; between two frames neither ever goes back.
        if timestamp_us < last[0] or frame < last[1]:
            return FrameStep(restarted=True)
        if timestamp_us == last[0]:
            return FrameStep(frozen=True)
        # Gaps are normal: QTM skips frames to keep its latency low.
        return FrameStep(lost=max(0, (frame - last[1]) // self._stride - 1))


BODIES = "bodies"
SETTLE_NS = NANOSECONDS // 10
"""How long frames in the old order may still come after QTM has reported a change of its settings [ns]."""


class MotionPublisher:
    """Publishes frames of one device.

    Bodies in a packet have no names: they stand in the order of the settings. While the settings are not
    known to fit, no body is published under a name that may be another's.
    """

    def __init__(self, config: QtmConfig, stream: ReadingStream[MotionFrame], health: Health) -> None:
        self._stream = stream
        self._health = health
        self._config = config
        self._continuity = Continuity(config.divisor)
        self._parameters: Parameters | None = None
        self._labels: list[tuple[int, str]] | None = None
        self._count = -1
        self._named_from_ns = 0
        self._last_visible_ns: dict[str, int] = {}

    def connected(self) -> None:
        """Begin with a new connection, without names."""
        self._continuity = Continuity(self._config.divisor)
        self._stream.start_epoch("connected")
        self._last_visible_ns.clear()
        self.forget_names()

    def forget_names(self, now_ns: int | None = None) -> None:
        """Forget the names: they may stand for other bodies now.

        Args:
            now_ns: When QTM reported it [ns]; frames that were on their way then come in the old order.
        """
        self._parameters = None
        self._labels = None
        self._named_from_ns = 0 if now_ns is None else now_ns + SETTLE_NS

    def learn_names(self, parameters: Parameters) -> None:
        """Use settings that hold from now on."""
        self._parameters = parameters
        self._labels = None
        self._count = -1
        missing = sorted(set(self._config.bodies) - set(parameters.bodies))
        if missing:
            what = f"QTM has no body {', '.join(map(repr, missing))}; it has {', '.join(parameters.bodies)}"
            self._health.alarms.set(BODIES, what, "name the bodies in QTM as in `bodies`, and enable them")
        else:
            self._health.alarms.clear(BODIES)

    def publish(self, frame: BodyFrame, arrival_ns: int) -> bool:
        """Publish a frame, and return whether the names of its bodies are known."""
        step = self._continuity.step(frame.timestamp_us, frame.frame)
        if step.restarted:
            self._stream.start_epoch("measurement restarted")
        self._health.gaps += step.lost
        fitting = self._fit(len(frame.values))
        named = fitting and arrival_ns >= self._named_from_ns
        measured = poses(frame) if named else []
        by_name = {name: measured[index] for index, name in (self._labels or ()) if named}
        # Mapped here, because the known latency comes off the estimate for the arrival.
        device_ns = frame.timestamp_us * 1000
        mapped_ns = self._stream.clock_map.update(device_ns, arrival_ns, self._stream.epoch)
        measured_ns = mapped_ns - round(self._config.latency_s * NANOSECONDS)
        lost = self._lost(by_name, measured_ns)
        flags = [flag for flag, holds in (("frozen", step.frozen), ("names_unknown", not named)) if holds]
        self._stream.publish(
            MotionFrame(by_name, lost, frame.drop_rate, frame.out_of_sync_rate),
            host_ns=arrival_ns,
            device_time_ns=device_ns,
            measured_ns=measured_ns,
            sequence=frame.frame,
            valid=not step.frozen and any(pose is not None for pose in by_name.values()),
            flags=(*flags, *(f"lost:{name}" for name in lost)),
        )
        return fitting

    def _fit(self, count: int) -> bool:
        """Find the labels for a number of bodies; they are kept while it stays."""
        if count != self._count:
            self._count, self._labels = count, None
        if self._labels is None and self._parameters is not None:
            names = self._parameters.names(count)
            if names is not None:
                self._labels = [
                    (index, self._config.bodies.get(name, name))
                    for index, name in enumerate(names)
                    if not self._config.bodies or name in self._config.bodies
                ]
        return self._labels is not None

    def _lost(self, by_name: Mapping[str, BodyPose | None], measured_ns: int) -> dict[str, float]:
        """Return how long bodies have been lost [s], and raise or clear their alarms."""
        lost: dict[str, float] = {}
        alarms, limit = self._health.alarms, self._config.body_lost_after_s
        for name, pose in by_name.items():
            key = f"lost:{name}"
            if pose is not None:
                self._last_visible_ns[name] = measured_ns
                alarms.clear(key)
                continue
            age_ns = measured_ns - self._last_visible_ns.setdefault(name, measured_ns)
            lost[name] = age_ns / NANOSECONDS
            if lost[name] >= limit and key not in alarms:
                cure = "check that its markers are attached and visible to the cameras"
                alarms.set(key, f"the cameras have lost body {name!r}", cure, limit=limit, unit="s")
        return lost
