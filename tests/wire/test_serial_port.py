"""The pseudo-terminal of the serial fakes: pacing, speed, who listens, unplugging."""

import asyncio
import os
import termios

import pytest
import serial

BNO = {"name": "imu", "kind": "bno08x_rvc"}


class Host:
    """A host with the port open, collecting what comes."""

    def __init__(self, link, baud=115200):
        self.port = serial.Serial(str(link), baud, timeout=0)
        self.data = bytearray()
        self.ended = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self.port.fileno(), self._read)

    def _read(self):
        try:
            data = os.read(self.port.fileno(), 4096)
        except BlockingIOError:
            return
        self.data += data
        if not data:
            self.ended.set()
            self._loop.remove_reader(self.port.fileno())

    def close(self):
        self._loop.remove_reader(self.port.fileno())
        self.port.close()


def session(wire, body, device=BNO, **keys):
    async def main():
        async with wire.bench({**device, **keys}, step_s=0.02) as rig:
            await body(rig, rig.serial_ports[device["name"]])

    wire.run(main, 20.0)


def test_a_stream_that_is_too_fast_for_its_line_slows_down(wire):
    async def body(rig, port):
        host = Host(port.link, 9600)
        await wire.until(lambda: host.data)
        host.port.write(bytes.fromhex("ff aa 03 0b 00"))
        begin, had = rig.clock.now(), len(host.data)
        await wire.until(lambda: len(host.data) >= had + 960)
        assert rig.clock.now() - begin == pytest.approx(1.0, rel=0.1)
        assert port.lost_bytes == 0
        host.close()

    session(wire, body, {"name": "imu", "kind": "witmotion", "needs_unlock": False}, baud=9600)


def test_while_nobody_listens_bytes_are_lost(wire):
    async def body(rig, port):
        await asyncio.sleep(2.0)
        host = Host(port.link)
        await wire.until(lambda: len(host.data) >= 19)
        index = host.data[host.data.index(b"\xaa\xaa") + 2]
        assert index > 190
        host.close()
        await asyncio.sleep(1.0)
        again = Host(port.link)
        await wire.until(lambda: len(again.data) >= 38)
        newer = again.data[again.data.index(b"\xaa\xaa") + 2]
        assert (newer - index) % 256 >= 90
        again.close()

    session(wire, body)


def test_another_speed_reads_rubbish_and_the_right_one_is_found(wire):
    async def body(rig, port):
        host = Host(port.link, 57600)
        await wire.until(lambda: len(host.data) > 500)
        assert bytes(host.data).count(b"\xaa\xaa") < 5
        attributes = termios.tcgetattr(host.port.fileno())
        attributes[4] = attributes[5] = termios.B115200
        termios.tcsetattr(host.port.fileno(), termios.TCSANOW, attributes)
        await asyncio.sleep(0.1)
        host.data.clear()
        await wire.until(lambda: len(host.data) > 500)
        assert bytes(host.data).count(b"\xaa\xaa") > 20
        host.close()

    session(wire, body)


def test_unplugging_ends_the_stream_and_the_link_leads_to_a_new_terminal(wire):
    async def body(rig, port):
        host = Host(port.link)
        await wire.until(lambda: host.data)
        rig.inject("imu", "unplug")
        await asyncio.wait_for(host.ended.wait(), 5.0)
        assert not port.link.exists()
        with pytest.raises(OSError, match="Input/output error"):
            os.write(host.port.fileno(), b"x")
        rig.boards["imu"].clear()
        new = Host(port.link)
        await wire.until(lambda: len(new.data) >= 19)
        assert new.data[new.data.index(b"\xaa\xaa") + 2] < 20
        assert port.plugs == 2
        host.close()
        new.close()

    session(wire, body)


def test_a_host_that_does_not_read_loses_bytes_and_blocks_nothing(wire):
    async def body(rig, port):
        idle = serial.Serial(str(port.link), 115200, timeout=0)
        await wire.until(lambda: port.lost_bytes > 0, 60.0)
        begin = rig.clock.now()
        await asyncio.sleep(0.5)
        assert rig.clock.now() - begin == pytest.approx(0.5, abs=0.1)
        idle.close()

    session(wire, body, rate_hz=400.0)


def test_a_board_that_resets_on_open_boots_for_every_host(wire):
    async def body(rig, port):
        async def greeted():
            host = Host(port.link)
            await wire.until(lambda: b"BendLabs" in host.data)
            host.close()

        await greeted()
        await asyncio.sleep(0.1)
        await greeted()

    session(wire, body, {"name": "bend", "kind": "bendlabs", "boot_s": 0.2, "resets_on_open": True})


@pytest.mark.parametrize(
    ("fault", "parameters"),
    [
        ("garbage", {"size": 30}),
        ("torn_frame", {}),
        ("bit_flip", {"per_byte": 0.05}),
        ("byte_loss", {"per_byte": 0.05}),
    ],
)
def test_faults_of_the_line_damage_frames_and_are_counted(wire, fault, parameters):
    async def body(rig, port):
        host = Host(port.link)
        await wire.until(lambda: len(host.data) > 100)
        rig.inject("imu", fault, parameters)
        await wire.until(lambda: rig.boards["imu"].counts[fault])
        rig.boards["imu"].clear()
        had = len(host.data)
        await wire.until(lambda: len(host.data) > had + 400)
        sound = damaged = 0
        for frame in bytes(host.data).split(b"\xaa\xaa")[1:-1]:
            good = len(frame) == 17 and sum(frame[:16]) & 0xFF == frame[16]
            sound, damaged = sound + good, damaged + (not good)
        assert sound > 20
        assert damaged >= 1
        host.close()

    session(wire, body)
