"""A valve terminal in memory, register by register as the manuals number them, in virtual time."""

import asyncio
from random import Random

from softarm.drivers.errors import ConnectionLost
from softarm.drivers.valves.bank import MpaConfig, ValveBank, VtemConfig
from softarm.drivers.valves.link import ModbusExceptionError, NoAnswer

TIMEOUT_S = 0.1
FILL_S = 0.05


class MemoryTerminal:
    """Sixteen valves at 45395 + 3 i (actual, echo, diagnosis) and 40003 + i (set-point), in mbar."""

    def __init__(self, clock, *, functions=(3, 6, 16, 23), watchdog_ms=0, latency_s=0.001):
        self.clock = clock
        self.functions = functions
        self.watchdog_ms = watchdog_ms
        self.latency_s = latency_s
        self.setpoints = [0] * 16
        self.actual = [0.0] * 16
        self.stuck = {}
        self.diagnosis = [0] * 16
        self.log = []
        self.faults = []
        self.refuses = {}
        self.links = []
        self.down = False
        self._updated_ns = None
        self._spoken_ns = None

    def update(self):
        now_ns = self.clock()
        if self._updated_ns is not None:
            share = min(1.0, (now_ns - self._updated_ns) / 1e9 / FILL_S)
            for valve, setpoint in enumerate(self.setpoints):
                self.actual[valve] += (setpoint - self.actual[valve]) * share
        self._updated_ns = now_ns
        silent_ms = 0 if self._spoken_ns is None else (now_ns - self._spoken_ns) / 1e6
        if self.watchdog_ms and silent_ms > self.watchdog_ms:
            self.clear_outputs()
        self._spoken_ns = now_ns

    def clear_outputs(self):
        self.setpoints = [0] * 16

    def read(self, address, count):
        if address >= 45395 and address + count <= 45395 + 48:
            words = []
            for valve in range(16):
                actual = round(self.stuck.get(valve, self.actual[valve])) & 0xFFFF
                words += [actual, self.setpoints[valve] & 0xFFFF, self.diagnosis[valve]]
            return words[address - 45395 : address - 45395 + count]
        if address == 46100 and self.watchdog_ms is not None:
            return [self.watchdog_ms]
        raise LookupError

    def write(self, address, words):
        self.log.append((self.clock(), address, list(words)))
        if address >= 40003 and address + len(words) <= 40003 + 16:
            self.setpoints[address - 40003 : address - 40003 + len(words)] = words
        elif address == 46100 and self.watchdog_ms is not None:
            self.watchdog_ms = max(words[0], 100)
        else:
            raise LookupError

    def writes(self):
        """All set-point blocks that arrived, with their times [s]."""
        return [(time / 1e9, words) for time, address, words in self.log if address == 40003]


class MemoryLink:
    """A connection to the terminal; a fault of its list bends one request each, or is called after it."""

    def __init__(self, terminal):
        self.terminal = terminal
        self.connected = True
        self.closed = 0
        terminal.links.append(self)

    async def read(self, address, count):
        return await self._serve(3, address, lambda: tuple(self.terminal.read(address, count)))

    async def write(self, address, words):
        await self._serve(16, address, lambda: self.terminal.write(address, words))

    async def write_one(self, address, word):
        await self._serve(6, address, lambda: self.terminal.write(address, [word]))

    async def exchange(self, read_address, read_count, write_address, words):
        def both():
            self.terminal.write(write_address, words)
            return tuple(self.terminal.read(read_address, read_count))

        return await self._serve(23, write_address, both)

    def close(self):
        self.connected = False
        self.closed += 1

    async def _serve(self, function, address, action):
        terminal = self.terminal
        if terminal.down:
            self.connected = False
        if not self.connected:
            raise ConnectionLost("valves", "dropped the connection", "look")
        await asyncio.sleep(terminal.latency_s)
        terminal.update()
        fault = terminal.faults.pop(0) if terminal.faults else None
        if function not in terminal.functions:
            raise ModbusExceptionError("valves", function, 1, address)
        if function in terminal.refuses:
            raise ModbusExceptionError("valves", function, terminal.refuses[function], address)
        if isinstance(fault, int):
            raise ModbusExceptionError("valves", function, fault, address)
        if isinstance(fault, Exception):
            raise fault
        try:
            answer = action() if fault != "unheard" else None
        except LookupError:
            raise ModbusExceptionError("valves", function, 2, address) from None
        if callable(fault):
            fault()
        if fault in ("unheard", "unanswered"):
            await asyncio.sleep(TIMEOUT_S)
            raise NoAnswer("valves", "did not answer", "look")
        return answer


CONFIG = {
    "name": "valves",
    "kind": "festo_mpa",
    "host": "192.0.2.1",
    "chambers": [3, 2, 1, 0, 4, 5],
    "maximum_pa": 50_000.0,
    "slew_pa_per_s": 200_000.0,
}


def build(virtual, terminal, sink=lambda reading: None, *, observe=False, **changes):
    """A bank on a terminal in memory."""
    config = MpaConfig.model_validate({**CONFIG, **changes})
    return on_memory(config, virtual, terminal, sink, observe)


def build_vtem(virtual, terminal, sink=lambda reading: None):
    """A bank on a VTEM terminal in memory."""
    config = VtemConfig.model_validate({**CONFIG, "kind": "festo_vtem"})
    return on_memory(config, virtual, terminal, sink, observe=False)


def on_memory(config, virtual, terminal, sink, observe):
    """What the configuration builds, with the link exchanged."""

    async def open_link():
        if terminal.down:
            raise ConnectionLost("valves", "refuses the connection", "look")
        return MemoryLink(terminal)

    return ValveBank(config, sink, virtual.clock, observe=observe, open_link=open_link, random=Random(1))
