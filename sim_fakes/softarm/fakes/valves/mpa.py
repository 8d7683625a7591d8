"""Sixteen MPA proportional valves: per valve actual pressure, set-point echo, diagnosis word."""

from collections.abc import Mapping, Sequence

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.signals import SignalFilter
from softarm.fakes.valves.pneumatics import MBAR, Pneumatics, Regulators

SUPPLY_FAULTY, CHANNEL_FAILED = 26, 31


def bank_faults(valves: int) -> tuple[Fault, ...]:
    """List what can go wrong with the valves."""
    channel = {"channel": (0, valves - 1)}
    return (
        Fault(
            "valve_fault",
            "one valve shuts, its diagnosis word is not 0",
            parameters={"channel": 0, "code": CHANNEL_FAILED},
            limits={**channel, "code": (1, 65535)},
        ),
        Fault(
            "stuck_valve",
            "one valve no longer moves; no diagnosis",
            parameters={"channel": 0},
            limits=channel,
        ),
        Fault(
            "supply_missing",
            "supply pressure falls; diagnosis words not 0",
            parameters={"mbar": 20.0},
            limits={"mbar": (0, 10000)},
        ),
        Fault(
            "reading_offset",
            "one sensor reads too much or too little (below zero: two's complement)",
            parameters={"channel": 0, "mbar": -1},
            limits={**channel, "mbar": (-32768, 32767)},
        ),
    )


def signed(word: int) -> int:
    """Read a register as two's complement."""
    return word - 0x10000 if word & 0x8000 else word


class RegulatedValves:
    """Proportional valves under the faults that both terminals share; arguments as of ``MpaBank``."""

    def __init__(
        self, faults: FaultBoard, valves: int, figures: Regulators, seed: int, signal_filter: SignalFilter
    ) -> None:
        self._faults = faults
        self._figures = figures
        self._pneumatics = Pneumatics(valves, figures, seed, signal_filter)
        self._free = np.ones(valves, dtype=np.bool_)

    def pressures(self) -> Floats:
        """Return the gauge pressures at the outlets [Pa], shape (valves,)."""
        return self._pneumatics.pressures

    def _advance(self, time: float, setpoints: Floats) -> None:
        self._free[:] = True
        if stuck := self._faults.active("stuck_valve"):
            self._free[int(stuck["channel"])] = False
        missing = self._faults.active("supply_missing")
        supply = float(missing["mbar"]) * MBAR if missing else self._figures.supply
        self._pneumatics.advance(time, setpoints, supply, self._free)

    def _words(self) -> list[int]:
        """Return each valve's actual pressure as it is read [mbar, two's complement]."""
        actual = np.rint(self._pneumatics.readings() / MBAR).astype(np.int64)
        if offset := self._faults.active("reading_offset"):
            actual[int(offset["channel"])] += int(offset["mbar"])
        return [int(mbar) & 0xFFFF for mbar in actual]


class MpaBank(RegulatedValves):
    """Proportional valves with set-points in mbar from output word 2 on.

    A negative set-point throws the regulator open, as the lab's code warns ("goes haywire").

    Args:
        faults: The board with at least ``bank_faults``.
        valves: Number of valves, one module each.
        figures: Figures of the regulators.
        seed: Seed of spread and noise.
        signal_filter: What is concealed in set-points and readings, in valve order.
    """

    def __init__(
        self, faults: FaultBoard, valves: int, figures: Regulators, seed: int, signal_filter: SignalFilter
    ) -> None:
        super().__init__(faults, valves, figures, seed, signal_filter)
        self.modules = valves
        self._echo = [0] * valves

    def setpoint_word(self, channel: int) -> int:
        """Return the output word (from word 2 on) of a channel's set-point."""
        return channel

    def update(self, time: float, outputs: Sequence[int]) -> None:
        """Advance to ``time`` [s] under the output words."""
        self._echo = list(outputs[: self.modules])
        setpoints = np.array([signed(word) for word in self._echo]) * MBAR
        wild = setpoints < 0
        setpoints = np.where(wild, self._figures.supply, setpoints)
        if broken := self._faults.active("valve_fault"):
            setpoints[int(broken["channel"])] = 0.0
        self._advance(time, setpoints)

    def inputs(self) -> list[int]:
        """Return three words per valve: actual [mbar, two's complement], echo, diagnosis."""
        errors = self.errors()
        words: list[int] = []
        for valve, actual in enumerate(self._words()):
            words += [actual, self._echo[valve], errors.get(valve + 1, 0)]
        return words

    def errors(self) -> Mapping[int, int]:
        """Return the CPX error number of each faulty module, modules counted from 1."""
        errors: dict[int, int] = {}
        if self._faults.active("supply_missing"):
            errors = dict.fromkeys(range(1, self.modules + 1), SUPPLY_FAULTY)
        if broken := self._faults.active("valve_fault"):
            errors[int(broken["channel"]) + 1] = int(broken["code"])
        return errors
