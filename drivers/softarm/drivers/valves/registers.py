"""Registers of the valve terminals: where each quantity lies and how its words read.

Sources: constants of the lab's own client for an MPA terminal on CPX with 16 proportional valves (actual
pressure, set-point echo and diagnosis of each valve from 45395 on, set-points from 40003 on); Festo VTEM
Motion Terminal (a status word and two pressures per slot). Words are signed: the manual of the MPA
electronics gives "sign + 15 bit, two's complement".
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

# Addresses go on the wire as they stand here, without an offset such as 40001. The process inputs begin at
# 45392 and the outputs at 40001, but their first words (3 and 2) are the diagnosis interface of the bus node.
INPUTS = 45395
OUTPUTS = 40003
# In no manual of the terminal; known from Festo's own client for other nodes, so the driver probes it.
WATCHDOG = 46100
MODULES_PRESENT = 45367
MODULES_FAULTY = 45383
TERMINAL_STATUS = 45391
STATUS_FORCE_ACTIVE = 1 << 15
STATUS_WRITE_PROTECTED = 1 << 11

MPA_VALVES = 16
VTEM_SLOTS = 8
VTEM_PRESSURE_APP = 3
VTEM_BOTH_VALVES = 3
VTEM_INACTIVE = 61
VTEM_ACKNOWLEDGE = 62
VTEM_READY = 1
VTEM_RUNNING = 2
VTEM_ERROR = 3


@dataclass(frozen=True, slots=True)
class TerminalInputs:
    """One decoded block of inputs, valve by valve.

    Attributes:
        actual: Measured pressure [counts], signed.
        echo: Set-point that stands in the terminal [counts]; None where the terminal does not echo it.
        diagnosis: Diagnosis word; zero is healthy. On VTEM the status word of the slot unless it is running.
    """

    actual: tuple[int, ...]
    echo: tuple[int, ...] | None
    diagnosis: tuple[int, ...]


class RegisterLayout(Protocol):
    """Where a terminal keeps its valves."""

    @property
    def valves(self) -> int:
        """How many valves the terminal has."""

    @property
    def read_count(self) -> int:
        """Words of the input block, from `INPUTS` on."""

    @property
    def write_count(self) -> int:
        """Words of the output block, from `OUTPUTS` on."""

    def decode(self, words: Sequence[int]) -> TerminalInputs:
        """Read the input block."""

    def encode(self, counts: Sequence[int]) -> list[int]:
        """Write the output block for these set-points [counts], one per valve."""

    def echo_of_outputs(self, words: Sequence[int]) -> tuple[int, ...]:
        """Read the set-points back from the output block [counts]."""

    @property
    def keeps_errors(self) -> bool:
        """Whether the terminal keeps an error until it is acknowledged."""

    def acknowledge(self, counts: Sequence[int], diagnosis: Sequence[int]) -> list[int]:
        """Write the output block that acknowledges errors where a valve's diagnosis is not zero."""


@dataclass(frozen=True, slots=True)
class MpaLayout:
    """MPA on CPX: three input words and one output word per valve."""

    valves: int = MPA_VALVES

    @property
    def read_count(self) -> int:
        """Words of the input block."""
        return 3 * self.valves

    @property
    def write_count(self) -> int:
        """Words of the output block."""
        return self.valves

    def decode(self, words: Sequence[int]) -> TerminalInputs:
        """Read actual pressure, set-point echo and diagnosis of each valve."""
        pressures = signed_all(words)
        return TerminalInputs(pressures[0::3], pressures[1::3], tuple(words[2::3]))

    def encode(self, counts: Sequence[int]) -> list[int]:
        """Write one set-point per word."""
        return [unsigned(count) for count in counts]

    def echo_of_outputs(self, words: Sequence[int]) -> tuple[int, ...]:
        """Read the set-points back."""
        return signed_all(words)

    @property
    def keeps_errors(self) -> bool:
        """Diagnosis words clear themselves."""
        return False

    def acknowledge(self, counts: Sequence[int], diagnosis: Sequence[int]) -> list[int]:  # noqa: ARG002
        """Write the set-points: there is nothing to acknowledge."""
        return self.encode(counts)


@dataclass(frozen=True, slots=True)
class VtemLayout:
    """VTEM: per slot a status or command word and the words of valves A and B."""

    slots: int = VTEM_SLOTS

    @property
    def valves(self) -> int:
        """How many valves the terminal has."""
        return 2 * self.slots

    @property
    def read_count(self) -> int:
        """Words of the input block."""
        return 3 * self.slots

    @property
    def write_count(self) -> int:
        """Words of the output block."""
        return 3 * self.slots

    def decode(self, words: Sequence[int]) -> TerminalInputs:
        """Read the pressures; a slot that does not regulate shows its status word as diagnosis."""
        statuses = [SlotStatus.decode(word) for word in words[0::3]]
        diagnosis = tuple(
            0 if status.regulating else word for status, word in zip(statuses, words[0::3], strict=True)
        )
        # The inputs hold no set-points; `Terminal.read` reads the output block back instead.
        return TerminalInputs(_pairs(words), None, tuple(word for word in diagnosis for _ in range(2)))

    def encode(self, counts: Sequence[int]) -> list[int]:
        """Write set-points under the command that keeps both valves of each slot regulating."""
        return self.encode_command(VTEM_PRESSURE_APP, VTEM_BOTH_VALVES, counts)

    def encode_command(self, app: int, control: int, counts: Sequence[int]) -> list[int]:
        """Write the same command to every slot, with set-points [counts]."""
        # Bits 5 to 0 of a command word are the app, bits 7 and 6 its control.
        return self._encode([app | control << 6] * self.slots, counts)

    @property
    def keeps_errors(self) -> bool:
        """A slot keeps its error until it is acknowledged."""
        return True

    def acknowledge(self, counts: Sequence[int], diagnosis: Sequence[int]) -> list[int]:
        """Write the set-points; a slot that does not regulate is commanded to release its error."""
        # Only where an error stands: a slot that acknowledges does not regulate.
        regulate, clear = VTEM_PRESSURE_APP | VTEM_BOTH_VALVES << 6, VTEM_ACKNOWLEDGE | 1 << 6
        return self._encode([clear if word else regulate for word in diagnosis[0::2]], counts)

    def _encode(self, commands: Sequence[int], counts: Sequence[int]) -> list[int]:
        words: list[int] = []
        for command, first, second in zip(commands, counts[0::2], counts[1::2], strict=True):
            words += (command, unsigned(first), unsigned(second))
        return words

    def echo_of_outputs(self, words: Sequence[int]) -> tuple[int, ...]:
        """Read the set-points back."""
        return _pairs(words)


@dataclass(frozen=True, slots=True)
class SlotStatus:
    """Status word of a VTEM slot.

    Attributes:
        mode: App that runs, such as 3 for pressure regulation.
        state: 0 not ready, 1 ready, 2 running, 3 error.
    """

    mode: int
    state: int

    @classmethod
    def decode(cls, word: int) -> "SlotStatus":
        """Decode a status word."""
        return cls(word & 0x3F, (word >> 6) & 3)

    @property
    def regulating(self) -> bool:
        """Whether both valves follow their set-points."""
        return self.mode == VTEM_PRESSURE_APP and self.state == VTEM_RUNNING


def signed_all(words: Sequence[int]) -> tuple[int, ...]:
    """Read words as two's complement."""
    return struct.unpack(f"{len(words)}h", struct.pack(f"{len(words)}H", *words))


def unsigned(count: int) -> int:
    """Write two's complement as a word."""
    if not -0x8000 <= count <= 0x7FFF:
        raise ValueError(f"{count} does not fit a word of 16 bits")
    return count & 0xFFFF


def _pairs(words: Sequence[int]) -> tuple[int, ...]:
    pressures = signed_all(words)
    # The first of the three words of a slot is its status or its command.
    return tuple(pressures[index] for index in range(len(pressures)) if index % 3)
