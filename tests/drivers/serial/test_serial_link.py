"""The serial link on real pseudo-terminals."""

import asyncio
import os
import pty
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial

from softarm.drivers import serial_link
from softarm.drivers.clock import monotonic
from softarm.drivers.errors import ConnectionLost, ProtocolError
from softarm.drivers.gauges.device import LineGaugeConfig
from softarm.drivers.gauges.force import GaugeForce
from softarm.drivers.reading import Reading
from softarm.drivers.serial_link import SerialConfig, SerialLink, open_serial
from softarm.drivers.supervisor import ConnectionState


class Terminal:
    """A pseudo-terminal behind a link that stays, as a device behind `/dev/serial/by-id`."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.controller = -1
        self.slave = -1

    def plug(self) -> None:
        self.controller, self.slave = pty.openpty()
        tty.setraw(self.slave)
        self.link.symlink_to(os.ttyname(self.slave))

    def unplug(self) -> None:
        self.link.unlink(missing_ok=True)
        for descriptor in (self.controller, self.slave):
            if descriptor >= 0:
                os.close(descriptor)
        self.controller = self.slave = -1

    def say(self, data: bytes) -> None:
        os.write(self.controller, data)


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    terminal = Terminal(tmp_path / "usb-Board-if00")
    terminal.plug()
    yield terminal
    terminal.unplug()


def config(port: Path, baud: int = 115200) -> SerialConfig:
    return LineGaugeConfig(name="gauge", port=str(port), baud=baud)


class Collector:
    """Waits for bytes."""

    def __init__(self, link: SerialLink) -> None:
        self.data = b""
        self._came = asyncio.Event()
        link.on_bytes = self._take

    def _take(self, data: bytes, arrival_ns: int) -> None:
        assert 0 <= monotonic() - arrival_ns < 10**9
        self.data += data
        self._came.set()

    async def until(self, end: bytes) -> bytes:
        async with asyncio.timeout(5):
            while not self.data.endswith(end):
                self._came.clear()
                await self._came.wait()
        return self.data


async def test_bytes_both_ways(terminal: Terminal) -> None:
    terminal.say(b"before it was opened")
    link = await open_serial(config(terminal.link))
    collector = Collector(link)
    terminal.say(b"hello\n")
    assert await collector.until(b"\n") == b"hello\n"
    link.write(b"?\r\n")
    assert os.read(terminal.controller, 10) == b"?\r\n"
    link.close()


async def test_unplugging_ends_the_link_and_takes_the_reader_off(terminal: Terminal) -> None:
    link = await open_serial(config(terminal.link))
    descriptor = link._port.fileno()
    terminal.unplug()
    with pytest.raises(ConnectionLost, match="gauge: was unplugged"):
        async with asyncio.timeout(5):
            await link.wait_lost()
    assert not asyncio.get_running_loop().remove_reader(descriptor)
    with pytest.raises(ConnectionLost, match="accepts no commands"):
        link.write(b"?")
    link.close()


async def test_work_on_a_lost_link_is_cancelled_and_the_loss_raised(terminal: Terminal) -> None:
    link = await open_serial(config(terminal.link))
    cancelled = asyncio.Event()

    async def work() -> None:
        try:
            await asyncio.Event().wait()
        finally:
            cancelled.set()

    asyncio.get_running_loop().call_soon(terminal.unplug)
    with pytest.raises(ConnectionLost):
        await link.while_open(work())
    assert cancelled.is_set()
    link.close()


async def test_a_port_is_opened_once(terminal: Terminal) -> None:
    link = await open_serial(config(terminal.link))
    with pytest.raises(ConnectionLost, match="is in use; close the other program"):
        await open_serial(config(terminal.link))
    link.close()
    (await open_serial(config(terminal.link))).close()


async def test_a_port_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConnectionLost, match="does not exist; plug it in"):
        await open_serial(config(tmp_path / "none", 9600))


async def test_a_file_that_is_no_port(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises((ConnectionLost, ProtocolError)):
        await open_serial(config(tmp_path / "file", 9600))


async def test_opening_that_is_cancelled_closes_the_port(
    terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    go_on, closed, loop = threading.Event(), asyncio.Event(), asyncio.get_running_loop()

    class Port(serial.Serial):
        def close(self) -> None:
            super().close()
            loop.call_soon_threadsafe(closed.set)

    def slow_open(config: SerialConfig) -> serial.Serial:
        assert go_on.wait(5)
        return original(config)

    original = serial_link._open
    monkeypatch.setattr(serial_link, "_open", slow_open)
    monkeypatch.setattr(serial_link.serial, "Serial", Port)
    opening = asyncio.create_task(open_serial(config(terminal.link)))
    await asyncio.sleep(0)
    opening.cancel()
    with pytest.raises(asyncio.CancelledError):
        await opening
    go_on.set()
    async with asyncio.timeout(5):
        await closed.wait()


class Rig:
    """A line gauge on a terminal."""

    def __init__(self, terminal: Terminal, **options: float) -> None:
        self.readings: asyncio.Queue[Reading[GaugeForce]] = asyncio.Queue()
        config = LineGaugeConfig(
            name="gauge", port=str(terminal.link), unit="N", identify_s=options.get("identify_s", 5.0)
        )
        self.device = config.build(self.readings.put_nowait)

    async def next(self) -> Reading[GaugeForce]:
        async with asyncio.timeout(5):
            return await self.readings.get()


async def connect(rig: Rig, terminal: Terminal, lines: bytes) -> None:
    """Connect while the board prints."""
    connecting = asyncio.create_task(rig.device.connect())
    await rig.device.supervisor.wait_for(ConnectionState.IDENTIFY)
    terminal.say(lines)
    await connecting


async def test_a_gauge_that_is_unplugged_comes_back_in_a_new_epoch(terminal: Terminal) -> None:
    rig = Rig(terminal)
    await connect(rig, terminal, b"torn\n1.50\n2.50\n")
    first, second = await rig.next(), await rig.next()
    assert (first.value.force, second.value.force) == (1.5, 2.5)
    assert first.valid
    assert first.epoch == second.epoch
    terminal.unplug()
    await rig.device.supervisor.wait_for(ConnectionState.FAULT)
    terminal.plug()
    await rig.device.supervisor.wait_for(ConnectionState.IDENTIFY)
    terminal.say(b"50\n3.50\n")
    third = await rig.next()
    assert third.value.force == 3.5
    assert third.epoch > second.epoch
    await rig.device.supervisor.wait_for(ConnectionState.STREAMING)
    assert rig.device.health.reconnects == 1
    await rig.device.close()


async def test_garbage_names_the_speed_and_what_was_expected(terminal: Terminal) -> None:
    rig = Rig(terminal)
    connecting = asyncio.create_task(rig.device.connect())
    await rig.device.supervisor.wait_for(ConnectionState.IDENTIFY)
    terminal.say(b"\xf0\x0f" * 300)
    with pytest.raises(ExceptionGroup) as caught:
        await connecting
    (error,) = caught.value.exceptions
    assert isinstance(error, ProtocolError)
    assert "no valid frame in 600 bytes at 115200 baud" in str(error)
    assert "wrong baud rate or wrong protocol; expected lines with one number" in str(error)
    await rig.device.close()


async def test_a_few_wrong_bytes_and_nothing_more(terminal: Terminal) -> None:
    rig = Rig(terminal, identify_s=0.05)
    connecting = asyncio.create_task(rig.device.connect())
    await rig.device.supervisor.wait_for(ConnectionState.IDENTIFY)
    terminal.say(b"hello\nhello\n")
    with pytest.raises(ExceptionGroup, match="not connected") as caught:
        await connecting
    assert isinstance(caught.value.exceptions[0], ProtocolError)
    await rig.device.close()


async def test_silence_is_told_from_garbage(terminal: Terminal) -> None:
    rig = Rig(terminal, identify_s=0.05)
    with pytest.raises(ExceptionGroup) as caught:
        await rig.device.connect()
    (error,) = caught.value.exceptions
    assert isinstance(error, ConnectionLost)
    assert "sends nothing at 115200 baud (limit 0.05 s); switch it on" in str(error)
    await rig.device.close()


async def test_closing_leaves_the_port_free(terminal: Terminal) -> None:
    rig = Rig(terminal)
    await connect(rig, terminal, b"\n1.00\n")
    await rig.device.close()
    assert rig.device.state is ConnectionState.DISCONNECTED
    (await open_serial(config(terminal.link))).close()
