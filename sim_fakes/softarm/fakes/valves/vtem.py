"""VTEM motion terminal: eight slots of two valves, each slot with its own state machine.

Words, modes and states as in Festo's manual of the terminal and in tud-cor-sr/ros2-vtem-control; how long the
slots take is a guess within the limits that this driver waits for.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softarm.fakes.faults import Fault, FaultBoard
from softarm.fakes.signals import SignalFilter
from softarm.fakes.valves.mpa import RegulatedValves, bank_faults, signed
from softarm.fakes.valves.pneumatics import MBAR, Regulators

SLOTS = 8
PRESSURE_REGULATION, INACTIVE, ACKNOWLEDGE = 3, 61, 62
NOT_READY, READY, RUNNING, ERROR = 0, 1, 2, 3
LOWEST_MBAR, HIGHEST_MBAR = -900, 7000
BOOT_S, ACTIVATION_S, DEACTIVATION_S = 0.5, 0.8, 0.3
VALVE_ERROR = 16


def vtem_faults() -> tuple[Fault, ...]:
    """List what can go wrong with the slots and valves."""
    valves = tuple(fault for fault in bank_faults(2 * SLOTS) if fault.name != "valve_fault")
    slot = Fault(
        "valve_fault",
        "a slot goes to its error state until it is acknowledged",
        once=True,
        parameters={"slot": 0},
        limits={"slot": (0, SLOTS - 1)},
    )
    return (*valves, slot)


@dataclass
class _Slot:
    """State machine of one slot: what was commanded, what it is, when the change is done."""

    mode: int = INACTIVE
    state: int = NOT_READY
    commanded: int = 0
    due: float = BOOT_S
    target: tuple[int, int] = (INACTIVE, READY)

    def command(self, time: float, word: int) -> None:
        """Handle the command word: mode in bits 0-5, which valves regulate in bits 6-7."""
        commanded = word & 0xFF
        if commanded != self.commanded:
            self.commanded = commanded
            self._switch(time, commanded & 0x3F, commanded >> 6)
        if time >= self.due:
            self.mode, self.state = self.target

    def fail(self) -> None:
        """Go to the error state."""
        self.state, self.target = ERROR, (self.mode, ERROR)

    def _switch(self, time: float, mode: int, control: int) -> None:
        if mode == ACKNOWLEDGE:
            self.target, self.due = (ACKNOWLEDGE, READY), time + DEACTIVATION_S
        elif self.target[1] == ERROR:
            return  # a slot in error heeds nothing but the acknowledgement
        elif mode in (0, INACTIVE):
            self.target, self.due = (INACTIVE, READY), time + DEACTIVATION_S
        elif mode == PRESSURE_REGULATION:
            self.target, self.due = (mode, RUNNING if control else READY), time + ACTIVATION_S
        else:
            self.target, self.due = (mode, ERROR), time + DEACTIVATION_S


class VtemBank(RegulatedValves):
    """Sixteen valves in eight slots; a valve regulates only while its slot runs mode 3 with it selected.

    Args:
        faults: The board with at least ``vtem_faults``.
        figures: Figures of the valves.
        seed: Seed of spread and noise.
        signal_filter: What is concealed in set-points and readings, in valve order.
    """

    def __init__(
        self, faults: FaultBoard, figures: Regulators, seed: int, signal_filter: SignalFilter
    ) -> None:
        super().__init__(faults, 2 * SLOTS, figures, seed, signal_filter)
        self.modules = SLOTS
        self._slots = [_Slot() for _ in range(SLOTS)]

    def setpoint_word(self, channel: int) -> int:
        """Return the output word (from word 2 on) of a channel's set-point."""
        return 3 * (channel // 2) + 1 + channel % 2

    def update(self, time: float, outputs: Sequence[int]) -> None:
        """Advance to ``time`` [s] under the output words."""
        if broken := self._faults.hit("valve_fault"):
            self._slots[int(broken["slot"])].fail()
        setpoints = np.zeros(2 * SLOTS)
        for number, slot in enumerate(self._slots):
            word, first, second = outputs[3 * number : 3 * number + 3]
            slot.command(time, word)
            if slot.mode == PRESSURE_REGULATION and slot.state == RUNNING:
                wanted = (signed(first) if word & 0x80 else 0, signed(second) if word & 0x40 else 0)
                if not all(LOWEST_MBAR <= mbar <= HIGHEST_MBAR for mbar in wanted):
                    slot.fail()
                    continue
                setpoints[2 * number : 2 * number + 2] = wanted
        self._advance(time, setpoints * MBAR)

    def inputs(self) -> list[int]:
        """Return three words per slot: status, actual of the first valve, of the second [mbar]."""
        actual = self._words()
        words: list[int] = []
        for number, slot in enumerate(self._slots):
            words += [slot.mode | slot.state << 6, *actual[2 * number : 2 * number + 2]]
        return words

    def errors(self) -> Mapping[int, int]:
        """Return the error number of each faulty slot, slots counted from 1."""
        return {number + 1: VALVE_ERROR for number, slot in enumerate(self._slots) if slot.state == ERROR}
