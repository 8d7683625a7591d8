"""Effects of the sensors, as filters of their signals."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.effects.effect import EffectParameter, Filter, Numbers, Where, instrument_effect
from softarm.fakes.plant.effects.places import azimuth
from softarm.fakes.plant.rotations import inverse, product, quaternion_vector, vector_quaternion


def rotated(signal: str, value: Floats, vector: Floats) -> Floats:
    """Add a rotation in the sensor's frame [rad] to a pose or, by its first two components, to a bend.

    A small rotation (a, b) about x and y tilts the z axis by (b, -a).
    """
    if signal == "pose":
        return np.concatenate([value[:3], product(value[3:], vector_quaternion(vector))])
    return np.asarray(value + np.array([vector[1], -vector[0]]))


@dataclass(frozen=True)
class Misalignment:
    """Rotate poses about the section's axis and bends in their plane."""

    signal: str
    yaw: float

    def update(self, time: float, value: Floats) -> Floats:  # noqa: ARG002
        """Pass a pose or a bend through."""
        if self.signal == "pose":
            return rotated("pose", value, np.array([0.0, 0.0, self.yaw]))
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        return np.array([cosine * value[0] + sine * value[1], cosine * value[1] - sine * value[0]])


@instrument_effect(("pose", "bend"), places=("sensor",), yaw=EffectParameter("rad", 0.1, 0.04, 0.25))
def frame_misalignment(signal: str, where: Where, numbers: Numbers) -> Filter:  # noqa: ARG001
    """Make the filter of one sensor.

    A sensor whose mount is rotated about the arm's axis: it sees each bend in another direction.
    """
    return Misalignment(signal, numbers["yaw"])


@dataclass(frozen=True)
class ReadingOffset:
    """Add a constant, or what grows from time 0: a rotation to an orientation, newtons to a gauge."""

    signal: str
    vector: Floats
    offset: float
    grows: bool

    def update(self, time: float, value: Floats) -> Floats:
        """Pass a reading through."""
        share = time if self.grows else 1.0
        if self.signal in ("pose", "bend"):
            return rotated(self.signal, value, share * self.vector)
        return value + share * self.offset


def offset_filter(signal: str, where: Where, angle: float, offset: float, *, grows: bool = False) -> Filter:
    """Make a filter: an orientation is off by an angle about the axis of a place, a gauge by an offset."""
    direction = azimuth(where)
    vector = angle * np.array([np.cos(direction), np.sin(direction), 0.0])
    return ReadingOffset(signal, vector, offset if angle != 0.0 else 0.0, grows)


@instrument_effect(
    ("pose", "bend", "gauge"),
    places=("sensor", "axis"),
    angle=EffectParameter("rad", 0.03, 0.012, 0.1),
    offset=EffectParameter("N", 0.05, 0.02, 0.2),
)
def sensor_bias(signal: str, where: Where, numbers: Numbers) -> Filter:
    """Make the filter: an orientation is off by ``angle`` about ``axis``, a gauge by ``offset``.

    A sensor that is off by a constant.
    """
    return offset_filter(signal, where, numbers["angle"], numbers["offset"])


@instrument_effect(
    ("pose", "bend", "gauge"),
    places=("sensor", "axis"),
    rate=EffectParameter("rad/s", 1e-4, 4e-5, 4e-4),
    offset=EffectParameter("N/s", 2e-4, 5e-5, 5e-4),
)
def sensor_drift(signal: str, where: Where, numbers: Numbers) -> Filter:
    """Make the filter: an orientation rotates at ``rate`` about ``axis``, a gauge drifts at ``offset``.

    A sensor that wanders off steadily with the clock.
    """
    return offset_filter(signal, where, numbers["rate"], numbers["offset"], grows=True)


@dataclass
class Latency:
    """Return the reading of ``delay`` ago, interpolated; the first one until there is any."""

    delay: float
    past: deque[tuple[float, Floats]] = field(default_factory=deque)

    def update(self, time: float, value: Floats) -> Floats:
        """Pass a reading through."""
        self.past.append((time, value))
        wanted = time - self.delay
        while len(self.past) > 2 and self.past[1][0] <= wanted:
            self.past.popleft()
        (before, old), (after, new) = self.past[0], self.past[min(1, len(self.past) - 1)]
        if after <= before or wanted <= before:
            return old
        share = min(1.0, (wanted - before) / (after - before))
        return np.asarray(old + share * (new - old))


@instrument_effect(("pose", "bend", "gauge"), places=("sensor",), delay=EffectParameter("s", 0.1, 0.04, 0.25))
def sensor_latency(signal: str, where: Where, numbers: Numbers) -> Filter:  # noqa: ARG001
    """Make the filter of one sensor.

    A sensor that reports what was some time ago.
    """
    return Latency(numbers["delay"])


@dataclass
class Scale:
    """Scale a bend or a pull; of a pose, the displacement and rotation since the first reading."""

    signal: str
    factor: float
    first: Floats | None = None

    def update(self, time: float, value: Floats) -> Floats:  # noqa: ARG002
        """Pass a reading through."""
        if self.signal != "pose":
            return value * self.factor
        if self.first is None:
            self.first = value.copy()
        place, orientation = self.first[:3], self.first[3:]
        moved = place + self.factor * (value[:3] - place)
        rotation = quaternion_vector(product(inverse(orientation), value[3:]))
        return np.concatenate([moved, product(orientation, vector_quaternion(self.factor * rotation))])


@instrument_effect(
    ("pose", "bend", "gauge"), places=("sensor",), change=EffectParameter("", 0.05, 0.02, 0.15)
)
def sensor_scale(signal: str, where: Where, numbers: Numbers) -> Filter:  # noqa: ARG001
    """Make the filter of one sensor.

    A sensor whose scale is off: the wand of the cameras, the gain of a strip or a gauge.
    """
    return Scale(signal, 1.0 + numbers["change"])


@dataclass
class HeldReading:
    """Hold the reading at the start of the fault until its end, counted from the first reading."""

    start: float
    end: float
    first: float | None = None
    held: Floats | None = None

    def update(self, time: float, value: Floats) -> Floats:
        """Pass a reading through."""
        self.first = time if self.first is None else self.first
        if not self.start <= time - self.first < self.end:
            return value
        if self.held is None:
            self.held = value.copy()
        return self.held


@instrument_effect(
    ("pose", "bend", "gauge"),
    places=("sensor",),
    length=EffectParameter("s", 20.0, 5.0, 60.0),
    start=EffectParameter("s", 20.0, 10.0, 25.0),  # so that a run of 40 s shows it
)
def sensor_stuck(signal: str, where: Where, numbers: Numbers) -> Filter:  # noqa: ARG001
    """Make the filter of one sensor: stuck for ``length`` from ``start``.

    A sensor that repeats its last value for a while.
    """
    return HeldReading(numbers["start"], numbers["start"] + numbers["length"])
