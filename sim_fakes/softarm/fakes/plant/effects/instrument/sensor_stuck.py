"""A sensor that repeats its last value for a while."""

from dataclasses import dataclass

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.effects.effect import EffectParameter, Filter, InstrumentEffect, Numbers, Where


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


def make(signal: str, where: Where, numbers: Numbers) -> Filter:  # noqa: ARG001
    """Make the filter of one sensor: stuck for ``length`` from ``start``."""
    return HeldReading(numbers["start"], numbers["start"] + numbers["length"])


EFFECT = InstrumentEffect(
    "sensor_stuck",
    "length",
    {"length": EffectParameter("s", 20.0, 5.0, 60.0), "start": EffectParameter("s", 20.0, 10.0, 60.0)},
    ("sensor",),
    signals=("pose", "bend", "gauge"),
    make=make,
)
