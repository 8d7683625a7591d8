"""What a reading costs inside the drivers, without sockets: time, and memory over very many of them."""

import asyncio
import itertools
import os
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from softarm.common.tables import Cell
from softarm.drivers.clock import PollTick, monotonic
from softarm.drivers.health import Health
from softarm.drivers.qualisys.bodies import BodyFrame, decode_bodies
from softarm.drivers.qualisys.packets import PacketParser
from softarm.drivers.qualisys.poses import poses
from softarm.drivers.registry import load_devices
from softarm.drivers.serial_device import SerialDevice
from softarm.drivers.stream import ReadingStream
from softarm.drivers.valves import ValveBank
from softarm.drivers.valves.registers import INPUTS

MILLION = 1_000_000
PAGE = os.sysconf("SC_PAGE_SIZE")
VALVES = {
    "name": "valves",
    "kind": "festo_mpa",
    "host": "127.0.0.1",
    "chambers": [3, 2, 1, 0, 4, 5],
    "maximum_pa": 50e3,
}


@dataclass(frozen=True)
class DecodingCase:
    """One driver under load.

    Attributes:
        device: What it is.
        measures: What one reading comprises.
        produce: Makes so many readings, from bytes or words to the sink.
    """

    device: str
    measures: str
    produce: Callable[[int], None]


def cases() -> list[DecodingCase]:
    """List the drivers that are put under load."""
    return [
        DecodingCase("valves", "a pass: two requests in memory, echo, alarms", _passes()),
        DecodingCase("qualisys", "a packet of three bodies to poses", _packets()),
        DecodingCase("lutron", "a frame of 16 characters", _serial("lutron", _lutron_frames())),
        DecodingCase("bendlabs", "a line of three sensors", _serial("bendlabs", _bend_lines())),
        DecodingCase("bno08x_rvc", "a frame of 19 bytes", _serial("bno08x_rvc", _rvc_frames())),
    ]


def load(case: DecodingCase, readings: int) -> dict[str, Cell]:
    """Make so many readings and return their cost in time and memory.

    Args:
        case: The driver.
        readings: How many.
    """
    warm = max(1, readings // 10)
    case.produce(warm)
    resident, began = resident_kib(), time.perf_counter()
    case.produce(readings)
    seconds, grown = time.perf_counter() - began, resident_kib() - resident
    return {
        "device": case.device,
        "reading": case.measures,
        "us_per_reading": seconds / readings * 1e6,
        "readings_per_s": readings / seconds,
        "readings": readings,
        "memory_growth_kib": grown,
    }


def resident_kib() -> int:
    """Return how much memory the process holds [KiB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE // 1024


class InstantLink:
    """A terminal that answers at once, from memory, as a healthy one would."""

    def __init__(self) -> None:
        self._registers = [0] * (1 << 16)
        self.connected = True

    async def read(self, address: int, count: int) -> tuple[int, ...]:
        """Return a block."""
        return tuple(self._registers[address : address + count])

    async def write(self, address: int, words: Sequence[int]) -> None:
        """Put set-points into the echo."""
        self._registers[address : address + len(words)] = words
        self._registers[INPUTS + 1 : INPUTS + 3 * len(words) : 3] = words

    async def write_one(self, address: int, word: int) -> None:
        """Keep a setting."""
        self._registers[address] = word

    async def exchange(
        self, read_address: int, read_count: int, write_address: int, words: Sequence[int]
    ) -> tuple[int, ...]:
        """Put set-points into the echo, and return the block."""
        await self.write(write_address, words)
        return await self.read(read_address, read_count)

    def close(self) -> None:
        """Do nothing."""


def _passes() -> Callable[[int], None]:
    (config,) = load_devices([VALVES])
    bank = config.build()
    assert isinstance(bank, ValveBank)
    session = bank.session(InstantLink())
    asyncio.run(session.identify())
    numbers = itertools.count()

    async def run(count: int) -> None:
        for number in itertools.islice(numbers, count):
            await session.run_pass(PollTick(number, 0, 0))

    def produce(count: int) -> None:
        before = bank.health.frames
        asyncio.run(run(count))
        assert bank.health.frames - before == count

    return produce


def _packets() -> Callable[[int], None]:
    parser = PacketParser()
    stream: ReadingStream[Any] = ReadingStream("qtm", "bench", health=Health())
    packets = _numbered_packets()

    def produce(count: int) -> None:
        for packet in itertools.islice(packets, count):
            for _, whole in parser.feed(packet).frames:
                frame = decode_bodies(whole)
                assert isinstance(frame, BodyFrame)
                stream.publish(poses(frame), device_time_ns=frame.timestamp_us * 1000, sequence=frame.frame)

    return produce


def _serial(kind: str, frames: Iterator[bytes]) -> Callable[[int], None]:
    (config,) = load_devices([{"name": kind, "kind": kind, "port": "/dev/none"}])
    device = config.build()
    assert isinstance(device, SerialDevice)

    def produce(count: int) -> None:
        before = device.health.frames
        for frame in itertools.islice(frames, count):
            device.receive(frame, monotonic())
        assert device.health.frames - before >= count - 1, f"{kind}: frames were refused"

    return produce


def _numbered_packets() -> Iterator[bytes]:
    for number in itertools.count(1):
        yield body_packet(number)


def body_packet(number: int) -> bytes:
    """Return a data packet of three bodies at rest, numbered."""
    body = struct.pack("<12f", 10.0, 20.0, 30.0, 1, 0, 0, 0, 1, 0, 0, 0, 1)
    component = struct.pack("<IIIhh", 160, 5, 3, 0, 0) + 3 * body
    return struct.pack("<IIqII", 184, 3, number * 10_000, number, 1) + component


def _lutron_frames() -> Iterator[bytes]:
    for number in itertools.count():
        yield b"\x02415700%08d\r" % (number % 5000)


def _bend_lines() -> Iterator[bytes]:
    for number in itertools.count():
        yield b"%d.25,-1.50,%d.75,2.00,0.50,-0.25\r\n" % (number % 40, number % 30)


def _rvc_frames() -> Iterator[bytes]:
    for number in itertools.count():
        body = struct.pack("<B6h3x", number & 0xFF, number % 18000, -110, 2085, -371, -20, 977)
        yield b"\xaa\xaa" + body + bytes([sum(body) & 0xFF])


def against_qtm_rt(packets: int) -> list[dict[str, Cell]]:
    """Decode the same stream with this project's client and with the public one, in turn.

    Args:
        packets: How many packets of three bodies.

    Returns:
        One row each, from bytes of the stream to position and rotation of every body; none for
        the public client where it is not installed.
    """
    blobs = [body_packet(number) for number in range(1, 1001)]
    rounds = max(1, packets // len(blobs))
    decoders = {"this project": _ours(), "qtm_rt": _theirs()}
    best_us = {
        name: min(_timed(decode, blobs) for _ in range(rounds)) / len(blobs) * 1e6
        for name, decode in decoders.items()
        if decode is not None
    }
    slowest = max(best_us.values())
    return [
        {"client": name, "us_per_packet": cost, "times_faster": slowest / cost}
        for name, cost in best_us.items()
    ]


def _timed(decode: Callable[[bytes], int], blobs: Sequence[bytes]) -> float:
    began = time.perf_counter()
    bodies = 0
    for blob in blobs:
        bodies += decode(blob)
    seconds = time.perf_counter() - began
    assert bodies == 3 * len(blobs)
    return seconds


def _ours() -> Callable[[bytes], int]:
    parser = PacketParser()

    def decode(blob: bytes) -> int:
        bodies = 0
        for _, packet in parser.feed(blob).frames:
            frame = decode_bodies(packet)
            assert isinstance(frame, BodyFrame)
            bodies += len(frame.values)
        return bodies

    return decode


def _theirs() -> Callable[[bytes], int] | None:
    try:
        from qtm_rt.packet import QRTPacketType
        from qtm_rt.receiver import Receiver
    except ImportError:
        return None
    bodies: list[int] = []

    def on_data(packet: Any) -> None:
        _, found = packet.get_6d()
        bodies.append(len(found))

    receiver = Receiver({QRTPacketType.PacketData: on_data})

    def decode(blob: bytes) -> int:
        bodies.clear()
        receiver.data_received(blob)
        return sum(bodies)

    return decode


HOSTILE = """
from qtm_rt.receiver import Receiver
Receiver({}).data_received(bytes(8))
"""


def zero_size_header(patience_s: float = 2.0) -> list[dict[str, Cell]]:
    """Feed a header of size zero to both clients.

    Args:
        patience_s: How long to wait for the public one [s].
    """
    parser = PacketParser()
    began = time.perf_counter()
    faults = parser.feed(bytes(8)).faults
    elapsed = time.perf_counter() - began
    assert faults
    rows: list[dict[str, Cell]] = [
        {"client": "this project", "seconds": elapsed, "outcome": f"refused: {faults[0].detail}"}
    ]
    if _theirs() is not None:
        rows.append({"client": "qtm_rt", **_patiently(patience_s)})
    return rows


def _patiently(patience_s: float) -> dict[str, Cell]:
    began = time.perf_counter()
    try:
        subprocess.run([sys.executable, "-c", HOSTILE], timeout=patience_s, check=False, capture_output=True)
    except subprocess.TimeoutExpired:
        return {"seconds": patience_s, "outcome": "had not come back, was ended"}
    return {"seconds": time.perf_counter() - began, "outcome": "came back"}
