"""Effects of the valves, as filters of their pressures."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.fakes.plant.effects.effect import EffectParameter, Filter, Numbers, Where, instrument_effect

RANGE = 65e3
CHAMBERS = 16


def chamber_mask(where: Where) -> NDArray[np.bool_]:
    """Select the chamber that is given, or all of them, among as many as a valve bank can have."""
    mask = np.ones(CHAMBERS, dtype=bool)
    if "chamber" in where:
        mask[:] = False
        mask[int(where["chamber"])] = True
    return mask


@dataclass(frozen=True)
class ValveFilter:
    """Pass the pressures of the chosen chambers through a law [Pa]; others stay as they are."""

    law: Callable[[Floats], Floats]
    mask: NDArray[np.bool_]

    def update(self, time: float, value: Floats) -> Floats:  # noqa: ARG002
        """Pass the pressures through [Pa]."""
        return np.where(self.mask[: len(value)], self.law(value), value)


@instrument_effect(("valve", "pressure"), places=("chamber",), bias=EffectParameter("Pa", 2e3, 0.7e3, 5e3))
def pressure_bias(signal: str, where: Where, numbers: Numbers) -> Filter:
    """Make the filter of the valves, or of the pressure that they report.

    A valve whose own sensor is off: except when vented, it regulates above or below the set-point and does
    not see it.
    """
    bias = numbers["bias"] if signal == "valve" else -numbers["bias"]
    return ValveFilter(
        lambda value: np.where(value > 0.0, np.maximum(0.0, value + bias), value), chamber_mask(where)
    )


@instrument_effect(("valve",), places=("chamber",), loss=EffectParameter("Pa", 25e3, 18e3, 35e3))
def pressure_saturation(signal: str, where: Where, numbers: Numbers) -> Filter:  # noqa: ARG001
    """Make the filter of the valves: the limit lies ``loss`` below 65 kPa.

    A supply too weak: a valve that reaches less than its range.
    """
    limit = RANGE - numbers["loss"] if numbers["loss"] != 0.0 else np.inf
    return ValveFilter(lambda value: np.minimum(value, limit), chamber_mask(where))


@instrument_effect(("valve",), places=("chamber",), width=EffectParameter("Pa", 3e3, 1e3, 6e3))
def valve_deadband(signal: str, where: Where, numbers: Numbers) -> Filter:  # noqa: ARG001
    """Make the filter of the valves: zero up to ``width``, and that much less above.

    A valve that does not open for the first bit of its set-point.
    """
    return ValveFilter(lambda value: np.maximum(0.0, value - numbers["width"]), chamber_mask(where))
