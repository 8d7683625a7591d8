"""A sensor that reports what was some time ago."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.effects.effect import EffectParameter, Filter, InstrumentEffect, Numbers, Where


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


def make(signal: str, where: Where, numbers: Numbers) -> Filter:  # noqa: ARG001
    """Make the filter of one sensor."""
    return Latency(numbers["delay"])


EFFECT = InstrumentEffect(
    "sensor_latency",
    "delay",
    {"delay": EffectParameter("s", 0.1, 0.04, 0.25)},
    ("sensor",),
    signals=("pose", "bend", "gauge"),
    make=make,
)
