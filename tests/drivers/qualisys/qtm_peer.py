"""A scripted peer that speaks as QTM does, and a motion capture whose connection leads to it."""

import asyncio
import struct
from collections.abc import Callable
from typing import Any

import pytest

from softarm.drivers.errors import DeviceErrors
from softarm.drivers.qualisys.connection import QtmConnection
from softarm.drivers.qualisys.device import MotionCapture, QualisysConfig
from softarm.drivers.qualisys.poses import MotionFrame
from softarm.drivers.qualisys.session import QtmSession
from softarm.drivers.reading import Reading

IDENTITY = [1.0, 0, 0, 0, 1, 0, 0, 0, 1]


def packet(kind: int, body: bytes = b"") -> bytes:
    return struct.pack("<II", 8 + len(body), kind) + body


def text(kind: int, words: str) -> bytes:
    return packet(kind, words.encode() + b"\0")


def event(number: int) -> bytes:
    return packet(6, bytes([number]))


def frame(number: int, *x_mm: float | None, timestamp: int | None = None) -> bytes:
    rows = [struct.pack("<12f", x, 0, 0, *IDENTITY) if x is not None else b"\xff" * 48 for x in x_mm]
    component = struct.pack("<IIIhh", 16 + 48 * len(rows), 5, len(rows), 0, 0) + b"".join(rows)
    microseconds = number * 10_000 if timestamp is None else timestamp
    return packet(3, struct.pack("<qII", microseconds, number, 1) + component)


def settings(*names: str, euler: str = "Roll") -> bytes:
    bodies = "".join(f"<Body><Name>{name}</Name></Body>" for name in names)
    general = f'<General><EulerAngles First="{euler}" Second="Pitch" Third="Yaw"/></General>'
    return text(2, f"<QTM_Parameters_Ver_1.25>{general}<The_6D>{bodies}</The_6D></QTM_Parameters_Ver_1.25>")


class Peer:
    """Answers as QTM does, unless told otherwise."""

    def __init__(self) -> None:
        self.greeting = text(1, "QTM RT Interface connected")
        self.newest = "1.25"
        self.names: tuple[str, ...] = ("base", "tip")
        self.euler = "Roll"
        self.running = True
        self.mute = False
        self.refuse_stream = False
        self.commands: list[str] = []
        self.answers: dict[str, Callable[[], bytes]] = {}
        self.connections: list[QtmConnection] = []
        self.aborted = 0

    def connect(self, connection: QtmConnection) -> None:
        self.connections.append(connection)
        connection.connection_made(PeerTransport(self, connection))  # type: ignore[arg-type]
        self.send(self.greeting)

    def send(self, data: bytes) -> None:
        asyncio.get_running_loop().call_soon(self.connections[-1].data_received, data)

    def command(self, words: str) -> None:
        self.commands.append(words)
        if not self.mute and (answer := self.answer(words)):
            self.send(answer)

    def answer(self, words: str) -> bytes:
        if words in self.answers:
            return self.answers[words]()
        if words.startswith("Version"):
            known = float(words.split()[1]) <= float(self.newest)
            return (
                text(1, f"Version set to {words.split()[1]}") if known else text(0, "Version NOT supported")
            )
        if words == "QTMVersion":
            return text(1, "QTM Version is 2.3 (build 464)")
        if words == "GetState":
            return event(3 if self.running else 4)
        if words.startswith("GetParameters"):
            return settings(*self.names, euler=self.euler)
        if words.startswith("StreamFrames") and not words.endswith("Stop"):
            return text(0, "Parse Error") if self.refuse_stream else b"" if self.running else packet(4)
        return b""

    def count(self, start: str) -> int:
        return sum(words.startswith(start) for words in self.commands)


class PeerTransport:
    """What a connection writes to."""

    def __init__(self, peer: Peer, connection: QtmConnection) -> None:
        self._peer = peer
        self._connection = connection

    def write(self, data: bytes) -> None:
        size, kind = struct.unpack_from("<II", data)
        assert (size, kind) == (len(data), 1)
        self._peer.command(data[8:-1].decode())

    def abort(self) -> None:
        self._peer.aborted += 1

    def close(self) -> None:
        pass


class Capture(MotionCapture):
    """A motion capture whose connection leads to a scripted peer."""

    peer: Peer

    async def open(self) -> QtmSession:
        connection = QtmConnection(self.name, self.clock)
        self.peer.connect(connection)
        return QtmSession(self._config, connection, self._publisher, self.health, self.clock)


class Rig:
    """Device and peer."""

    def __init__(self, virtual: Any, **options: Any) -> None:
        self.readings: list[Reading[MotionFrame]] = []
        self.peer = Peer()
        config = QualisysConfig(name="mocap", host="10.0.0.1", **options)
        self.device = Capture(config, self.readings.append, virtual.clock)
        self.device.peer = self.peer

    async def say(self, *packets: bytes) -> None:
        """Send packets one hundredth of a second apart, and let them be worked off."""
        for data in packets:
            self.peer.send(data)
            await asyncio.sleep(0.01)


def run(virtual: Any, main: Callable[[Rig], Any], **options: Any) -> None:
    async def whole() -> None:
        rig = Rig(virtual, **options)
        try:
            await main(rig)
        finally:
            await rig.device.close()

    virtual.run(whole)


async def refused(rig: Rig, kind: type[Exception], match: str) -> None:
    with pytest.raises(DeviceErrors) as caught:
        await rig.device.connect()
    (error,) = caught.value.leaves()
    assert isinstance(error, kind)
    assert match in str(error)
