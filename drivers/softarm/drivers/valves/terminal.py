"""A valve terminal in counts: one block read and one block write, in one request where it accepts that."""

from dataclasses import dataclass, replace

from softarm.drivers.clock import Clock
from softarm.drivers.valves.link import ModbusExceptionError, RegisterLink
from softarm.drivers.valves.registers import INPUTS, OUTPUTS, RegisterLayout, TerminalInputs

ILLEGAL_FUNCTION = 1
ILLEGAL_ADDRESS = 2
UNSUPPORTED = (ILLEGAL_FUNCTION, ILLEGAL_ADDRESS)
"""A node without function 23, or without readable outputs, answers with either."""


@dataclass(frozen=True, slots=True)
class TimedInputs:
    """Inputs and when they were measured.

    Attributes:
        inputs: The decoded block.
        measured_ns: Host monotonic time half-way between request and answer [ns].
        arrival_ns: Host monotonic time of the answer [ns].
    """

    inputs: TerminalInputs
    measured_ns: int
    arrival_ns: int


class Terminal:
    """Reads and writes whole blocks."""

    def __init__(self, link: RegisterLink, layout: RegisterLayout, clock: Clock) -> None:
        self.link = link
        self.layout = layout
        self.exchanges = False
        self.echoes = True
        self._clock = clock
        self._diagnosis: tuple[int, ...] = (0,) * layout.valves

    async def read(self) -> TimedInputs:
        """Read the inputs; where they hold no echo, the output block is read back for it."""
        began_ns = self._clock()
        words = await self.link.read(INPUTS, self.layout.read_count)
        sample = self._sample(words, began_ns)
        if sample.inputs.echo is not None or not self.echoes:
            return sample
        outputs = await self.link.read(OUTPUTS, self.layout.write_count)
        return replace(sample, inputs=replace(sample.inputs, echo=self.layout.echo_of_outputs(outputs)))

    async def write(self, counts: tuple[int, ...], acknowledge: bool = False) -> TimedInputs | None:
        """Write the set-points, and return the inputs too where one request does both.

        Args:
            counts: Set-point of every valve.
            acknowledge: Clear the errors that the terminal keeps; those valves rest meanwhile.
        """
        layout = self.layout
        words = layout.acknowledge(counts, self._diagnosis) if acknowledge else layout.encode(counts)
        if not self.exchanges:
            await self.link.write(OUTPUTS, words)
            return None
        began_ns = self._clock()
        answer = await self.link.exchange(INPUTS, self.layout.read_count, OUTPUTS, words)
        return self._sample(answer, began_ns)

    async def probe_exchange(self, counts: tuple[int, ...]) -> None:
        """Write by function 23 and remember whether the terminal has it; write by function 16 if not."""
        self.exchanges = True
        try:
            await self.write(counts)
        except ModbusExceptionError as refusal:
            if refusal.code not in UNSUPPORTED:
                raise
            self.exchanges = False
            await self.write(counts)

    async def probe_echo(self) -> None:
        """Find out whether the set-points can be read back."""
        try:
            await self.read()
        except ModbusExceptionError as refusal:
            if refusal.code not in UNSUPPORTED:
                raise
            self.echoes = False
            await self.read()

    def _sample(self, words: tuple[int, ...], began_ns: int) -> TimedInputs:
        arrival_ns = self._clock()
        inputs = self.layout.decode(words)
        self._diagnosis = inputs.diagnosis
        return TimedInputs(inputs, (began_ns + arrival_ns) // 2, arrival_ns)
