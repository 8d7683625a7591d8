"""Proportional pressure regulators: dead time, first-order filling, choked exhaust, chattering inlet."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softarm.estimator.arrays import Floats
from softarm.fakes.signals import SignalFilter, unmodified

MBAR = 100.0


@dataclass(frozen=True)
class Regulators:
    """Figures of a bank of regulators, read off ``sopra_valve_steps_0-2`` of the development recordings.

    There a step to 30 kPa begins after 40 to 60 ms; the outlet sensor jumps between the filling chamber's
    pressure and up to 47 kPa while the valve pulses, settles with a time constant near 70 ms, ends 0.7 to
    0.9 kPa low, and the way down is linear at about 0.27 MPa/s.

    Args:
        dead_time: Shortest and longest dead time in the bank [s].
        fill_time: Time constant of filling [s].
        exhaust_rate: Rate of the choked exhaust [Pa/s].
        exhaust_time: Time constant of the last part of the exhaust [s].
        overshoot: Height of the inlet pulses over the pressure still missing.
        pulse_period: Period of the inlet pulses [s].
        bias: Smallest and largest steady shortfall in the bank [Pa].
        noise: Standard deviation of the reading [Pa].
        supply: Supply pressure, the most an outlet can reach [Pa].
        lowest: Lowest outlet pressure [Pa]; below zero where the terminal has vacuum.
    """

    dead_time: tuple[float, float] = (0.04, 0.06)
    fill_time: float = 0.07
    exhaust_rate: float = 270e3
    exhaust_time: float = 0.02
    overshoot: float = 1.3
    pulse_period: float = 0.02
    bias: tuple[float, float] = (500.0, 900.0)
    noise: float = 15.0
    supply: float = 250e3
    lowest: float = 0.0


class Pneumatics:
    """The state of a bank of regulators.

    Args:
        valves: Number of valves.
        figures: Their figures.
        seed: Seed of the spread between valves and of the noise.
        signal_filter: Hidden effects on set-points (``valve``) and readings (``pressure``), in valve order.
    """

    def __init__(
        self, valves: int, figures: Regulators, seed: int, signal_filter: SignalFilter = unmodified
    ) -> None:
        self._signal_filter = signal_filter
        self._random = np.random.default_rng(seed)
        self._figures = figures
        self._dead_time = self._random.uniform(*figures.dead_time, valves)
        self._bias = self._random.uniform(*figures.bias, valves)
        self._history: list[tuple[float, Floats]] = [(0.0, np.zeros(valves))]
        self._time = 0.0
        self.pressures: Floats = np.zeros(valves)
        self._missing: Floats = np.zeros(valves)

    def advance(self, time: float, setpoints: Floats, supply: float, free: NDArray[np.bool_]) -> None:
        """Step to ``time`` [s].

        Args:
            time: New time, later than the last one.
            setpoints: Gauge pressures commanded [Pa], shape (valves,).
            supply: Supply pressure now [Pa].
            free: Valves that still move, shape (valves,).
        """
        step, self._time = time - self._time, time
        # Only changes: at 500 steps a second the history of a dead time would grow long.
        if not np.array_equal(setpoints, self._history[-1][1]):
            self._history.append((time, setpoints.copy()))
        target = self._signal_filter("valve", None, time, self._target())
        target = np.clip(target, self._figures.lowest, supply)
        fill = (target - self.pressures) * min(1.0, step / self._figures.fill_time)
        over = self.pressures - target
        drop = np.minimum(
            self._figures.exhaust_rate * step, over * min(1.0, step / self._figures.exhaust_time)
        )
        self._missing = np.where(free & (over < 0), -over, 0.0)
        self.pressures = np.where(free, self.pressures + np.where(over > 0, -drop, fill), self.pressures)

    def readings(self) -> Floats:
        """Read the outlet sensors once [Pa], with pulses and noise, shape (valves,)."""
        phase = (self._time / self._figures.pulse_period) % 1.0
        jitter = self._random.uniform(0.6, 1.3, self.pressures.size)
        pulses = self._figures.overshoot * jitter * self._missing if phase < 0.5 else 0.0
        settled = np.where(self._missing > 3.0 * self._figures.bias[1], pulses, 0.0)
        noise = self._random.normal(0.0, self._figures.noise, self.pressures.size)
        return self._signal_filter("pressure", None, self._time, self.pressures + settled) + noise

    def _target(self) -> Floats:
        """Return what each regulator works towards: the set-point one dead time ago, less its bias."""
        due = self._time - self._dead_time
        target = self._history[0][1].copy()
        for since, setpoints in self._history[1:]:
            target = np.where(since <= due, setpoints, target)
        while len(self._history) > 1 and self._history[1][0] <= due.min():
            del self._history[0]
        biased: Floats = np.where(target > 0, np.maximum(target - self._bias, 0.0), target)
        return biased
