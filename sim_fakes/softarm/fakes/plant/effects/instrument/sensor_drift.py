"""A sensor that wanders off steadily with the clock."""

from softarm.fakes.plant.effects.effect import EffectParameter, Filter, InstrumentEffect, Numbers, Where
from softarm.fakes.plant.effects.instrument.sensor_bias import offset_filter


def make(signal: str, where: Where, numbers: Numbers) -> Filter:
    """Make the filter: an orientation turns at ``rate`` about ``axis``, a gauge goes off by ``offset``."""
    return offset_filter(signal, where, numbers["rate"], numbers["offset"], grows=True)


EFFECT = InstrumentEffect(
    "sensor_drift",
    "rate",
    {"rate": EffectParameter("rad/s", 1e-4, 4e-5, 4e-4), "offset": EffectParameter("N/s", 2e-4, 5e-5, 5e-4)},
    ("sensor", "axis"),
    signals=("pose", "bend", "gauge"),
    make=make,
)
