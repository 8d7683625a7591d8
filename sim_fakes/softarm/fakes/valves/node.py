"""Registers of a CPX Modbus node: process image, status block, diagnosis interface, watchdog.

Addresses are those on the wire: of Festo's CPX-E manual, and that of the watchdog of Festo's own client. What
a diagnosis word means on the real MPA module is not documented; here it is the CPX error number.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol

from softarm.estimator.arrays import Floats
from softarm.fakes.faults import Fault, FaultBoard

# Words 0 and 1 of the outputs and 0 to 2 of the inputs are the function-number interface of the node.
OUTPUTS = 40001
PROCESS_WORDS = 256
DIAGNOSIS_PARAMETERS = 40257
STATUS = 45357
INPUTS = 45392
DIAGNOSIS_MEMORY = 45648
WATCHDOG = 46100
SHORTEST_WATCHDOG_MS = 100

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_BUSY = 1, 2, 3, 6


def node_faults(channels: int) -> tuple[Fault, ...]:
    """List what can go wrong with the node."""
    return (
        Fault(
            "watchdog_fired", "outputs go to the fail-safe state, as when no master sends requests", once=True
        ),
        Fault("no_watchdog", "register 46100 answers exception 2"),
        Fault(
            "second_master",
            "another client writes one set-point",
            once=True,
            parameters={"channel": 0, "mbar": 123},
            limits={"channel": (0, channels - 1), "mbar": (0, 65535)},
        ),
    )


class ModbusError(Exception):
    """A request that the node answers with an exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"Modbus exception {code}")
        self.code = code


class Bank(Protocol):
    """The modules behind the node."""

    @property
    def modules(self) -> int:
        """Number of modules behind the node."""

    def update(self, time: float, outputs: Sequence[int]) -> None:
        """Advance to ``time`` [s] under the output words from word 2 on."""

    def inputs(self) -> list[int]:
        """Return the input words from word 3 on, each 0 to 65535."""

    def errors(self) -> Mapping[int, int]:
        """Return the CPX error number of each faulty module, modules counted from 1."""

    def setpoint_word(self, channel: int) -> int:
        """Return the index in the output words (from word 2 on) of a channel's set-point."""

    def pressures(self) -> Floats:
        """Return the gauge pressures at the outlets [Pa], shape (valves,)."""


class CpxNode:
    """The bus node with its process image.

    Args:
        bank: The modules.
        faults: The board with at least ``node_faults``.
        watchdog_ms: Time-out at power-on; 0 waits forever.
    """

    def __init__(self, bank: Bank, faults: FaultBoard, watchdog_ms: int = 0) -> None:
        self.faults = faults
        self.watchdog_trips = 0
        self._bank = bank
        self._outputs = [0] * PROCESS_WORDS
        self._inputs = [0] * PROCESS_WORDS
        self._stale = True
        self._memory = [0] * 8
        self._watchdog_ms = watchdog_ms
        self._last_request: float | None = None
        self._functions: dict[int, int] = {}

    def read(self, address: int, count: int) -> list[int]:
        """Read registers.

        Raises:
            ModbusError: Part of the range does not exist.
        """
        if self._stale and address >= INPUTS:
            self._refresh()
        for start, words in self._areas():
            if start <= address and address + count <= start + len(words):
                return list(words[address - start : address - start + count])
        raise ModbusError(ILLEGAL_ADDRESS)

    def write(self, address: int, values: Sequence[int]) -> None:
        """Write registers, all or none.

        Raises:
            ModbusError: Part of the range does not exist or is read-only.
        """
        if address == WATCHDOG and len(values) == 1 and not self.faults.hit("no_watchdog"):
            self._watchdog_ms = max(values[0], SHORTEST_WATCHDOG_MS) if values[0] else 0
            return
        for start, words in ((OUTPUTS, self._outputs), (DIAGNOSIS_PARAMETERS, self._memory)):
            if start <= address and address + len(values) <= start + len(words):
                words[address - start : address - start + len(values)] = values
                self._serve_function()
                return
        raise ModbusError(ILLEGAL_ADDRESS)

    def pressures(self) -> Floats:
        """Return the gauge pressures at the outlets [Pa], shape (valves,)."""
        return self._bank.pressures()

    def setpoint(self, channel: int) -> int:
        """Return the set-point that the terminal holds for a channel, as it stands in its register."""
        return self._outputs[2 + self._bank.setpoint_word(channel)]

    def note_request(self, time: float) -> None:
        """Feed the watchdog: a master has spoken."""
        self._last_request = time

    def power_on(self) -> None:
        """Start with all outputs off and no master seen."""
        self._outputs[:] = [0] * PROCESS_WORDS
        self._last_request = None

    def update(self, time: float) -> None:
        """Advance the modules to ``time`` [s]; outputs go off when the watchdog has expired."""
        silent = 0.0 if self._last_request is None else time - self._last_request
        if self._watchdog_ms and silent * 1e3 > self._watchdog_ms:
            self.watchdog_trips += 1
            self._last_request = None  # fires once; the next request starts it again
            self._fail_safe()
        if self.faults.hit("watchdog_fired"):
            self._fail_safe()
        if intruder := self.faults.hit("second_master"):
            self._outputs[2 + self._bank.setpoint_word(int(intruder["channel"]))] = int(intruder["mbar"])
        # The echo follows here and not at the write: a real node copies its image once per cycle of its own.
        self._bank.update(time, self._outputs[2:])
        self._stale = True

    def _refresh(self) -> None:
        words = self._bank.inputs()
        self._inputs[3 : 3 + len(words)] = words
        self._stale = False

    def _fail_safe(self) -> None:
        """Apply function 4402 bits 0 and 1: 0 resets the outputs, 1 holds them."""
        if self._functions.get(4402, 0) & 0b11 == 0:
            self._outputs[2:] = [0] * (PROCESS_WORDS - 2)

    def _areas(self) -> list[tuple[int, list[int]]]:
        areas = [
            (INPUTS, self._inputs),
            (OUTPUTS, self._outputs),
            (STATUS, self._status()),
            (DIAGNOSIS_PARAMETERS, self._memory),
            (DIAGNOSIS_MEMORY, [0] * 408),
        ]
        if not self.faults.active("no_watchdog"):
            areas.append((WATCHDOG, [self._watchdog_ms]))
        return areas

    def _status(self) -> list[int]:
        """Build the status block: modules present at word 10, faulty modules at word 26."""
        words = [0] * 35
        for module in range(self._bank.modules + 1):
            words[10 + module // 16] |= 1 << (module % 16)
        for module in self._bank.errors():
            words[26 + module // 16] |= 1 << (module % 16)
        return words

    def _serve_function(self) -> None:
        """Answer the function-number interface in the first two output and input words."""
        control = self._outputs[0]
        if not control & 0x8000:
            self._inputs[0] = 0
            return
        number = control & 0x1FFF
        if control & 0x2000:
            self._functions[number] = self._outputs[1]
        self._inputs[0] = 0x8000 | number
        self._inputs[1] = self._function_value(number)

    def _function_value(self, number: int) -> int:
        errors = self._bank.errors()
        if number == 1937:
            return min(errors, default=0)
        if 2008 <= number < 2008 + 4 * 48:
            module, item = divmod(number - 2008, 4)
            return errors.get(module, 0) if item == 1 else 0
        return self._functions.get(number, 0)
