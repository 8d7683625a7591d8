"""The load cell inside a force gauge: what the cord pulls, with noise, zero and range."""

from dataclasses import dataclass

import numpy as np

from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.plant.state import PlantState
from softarm.fakes.signals import See, plainly

STANDARD_GRAVITY = 9.80665
NEWTONS_PER = {
    "N": 1.0,
    "kN": 1e3,
    "mN": 1e-3,
    "g": STANDARD_GRAVITY * 1e-3,
    "kg": STANDARD_GRAVITY,
    "lb": 4.4482216152605,
    "oz": 0.27801385095378,
}

GAUGE_FAULTS = (
    Fault("over_range", "the load is beyond the range"),
    Fault("operator_zero", "the operator presses zero", once=True),
    Fault("power_off", "the gauge has switched itself off, until the operator switches it on (cleared)"),
    Fault("offset", "the zero has drifted", parameters={"newtons": 0.05}, limits={"newtons": (-50, 50)}),
)


@dataclass(frozen=True)
class CellFigures:
    """Figures of a load cell.

    Args:
        full_scale: Largest load either way [N]; 5 kg.
        noise: Standard deviation of a reading [N].
        drift: Drift of the zero [N/s].
        see: What is concealed in a ``gauge``.
    """

    full_scale: float = 5.0 * STANDARD_GRAVITY
    noise: float = 0.004
    drift: float = 0.0
    see: See = plainly


class LoadCell:
    """A load cell on the cord; pull is positive.

    Args:
        faults: The board with at least ``GAUGE_FAULTS``.
        cell: Its figures.
        seed: Seed of the noise.
    """

    def __init__(self, faults: FaultBoard, cell: CellFigures, seed: int) -> None:
        self._see = cell.see
        self._faults = faults
        self._cell = cell
        self._random = np.random.default_rng(seed)
        self._zero = 0.0

    def pull(self, state: PlantState) -> float:
        """Read the pull [N]; infinite when out of range."""
        if self._faults.hit("operator_zero"):
            self.press_zero(state)
        load = self._load(state)
        if self._faults.hit("over_range") or abs(load) > 1.02 * self._cell.full_scale:
            return float("inf")
        return load - self._zero + float(self._random.normal(0.0, self._cell.noise))

    def press_zero(self, state: PlantState) -> None:
        """Make the present load the zero."""
        self._zero = self._load(state)

    def is_off(self) -> bool:
        """Return whether the gauge is switched off, and count the reading that it swallows."""
        return self._faults.hit("power_off") is not None

    def _load(self, state: PlantState) -> float:
        offset = self._faults.active("offset")
        shift = float(offset["newtons"]) if offset else 0.0
        pull = self._see("gauge", "gauge_cord", state.time, np.array([state.cord_force]))
        return float(pull[0]) + shift + self._cell.drift * state.time
