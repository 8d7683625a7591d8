"""The load cell inside a force gauge: what the cord pulls, with noise, zero and range."""

import numpy as np

from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.parts import GaugePart
from softarm.fakes.plant.state import PlantState
from softarm.fakes.signals import SignalFilter

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


class LoadCell:
    """A load cell on the cord; pull is positive.

    Args:
        part: The gauge around it.
        faults: The board with at least ``GAUGE_FAULTS``.
        seed: Seed of the noise.
        signal_filter: What is concealed in a ``gauge``.
    """

    def __init__(self, part: GaugePart, faults: FaultBoard, seed: int, signal_filter: SignalFilter) -> None:
        self._part = part
        self._faults = faults
        self._signal_filter = signal_filter
        self._random = np.random.default_rng(seed)
        self._zero = 0.0

    def pull(self, state: PlantState) -> float:
        """Read the pull [N]; infinite when out of range."""
        if self._faults.hit("operator_zero"):
            self.press_zero(state)
        load = self._load(state)
        if self._faults.hit("over_range") or abs(load) > 1.02 * self._part.full_scale_n:
            return float("inf")
        return load - self._zero + float(self._random.normal(0.0, self._part.noise_n))

    def press_zero(self, state: PlantState) -> None:
        """Make the present load the zero."""
        self._zero = self._load(state)

    def is_off(self) -> bool:
        """Return whether the gauge is switched off, and count the reading that it swallows."""
        return self._faults.hit("power_off") is not None

    def _load(self, state: PlantState) -> float:
        offset = self._faults.active("offset")
        shift = float(offset["newtons"]) if offset else 0.0
        pull = self._signal_filter("gauge", "gauge_cord", state.time, np.array([state.cord_force]))
        return float(pull[0]) + shift + self._part.drift_n_per_s * state.time
