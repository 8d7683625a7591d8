"""The byte vectors of the manuals over real sockets: what goes in, and byte for byte what comes out."""

import asyncio
import tomllib
from pathlib import Path

import pytest

VECTORS = tomllib.loads((Path(__file__).parents[1] / "drivers" / "vectors.toml").read_text())
MODBUS, QTM = VECTORS["modbus"], VECTORS["qtm"]
VALVES = {"name": "valves", "kind": "festo_mpa"}
MOCAP = {"name": "qtm", "kind": "qualisys"}


def octets(text):
    return bytes.fromhex(text)


def talk(wire, device, body):
    """Run ``body(rig, reader, writer)`` on a plain TCP connection."""

    async def main():
        async with wire.bench(device) as rig:
            (endpoint,) = rig.endpoints()
            reader, writer = await asyncio.open_connection(endpoint.host, endpoint.port)
            await body(rig, reader, writer)
            writer.close()

    wire.run(main)


@pytest.mark.parametrize(
    ("request_bytes", "reply"),
    [
        (MODBUS["write_all"]["bytes"], MODBUS["write_all"]["reply"]),
        (MODBUS["watchdog"]["bytes"], MODBUS["watchdog"]["bytes"]),
        ("00 07 00 00 00 06 ff 03 b4 14 00 01", "00 07 00 00 00 05 ff 03 02 00 00"),
        ("00 08 00 00 00 06 01 03 b1 37 00 03", "00 08 00 00 00 09 01 03 06 ff ff 00 01 00 00"),
        ("00 09 00 00 00 06 01 04 b1 53 00 01", "00 09 00 00 00 03 01 84 01"),
        ("00 0a 00 00 00 06 01 03 c3 50 00 01", "00 0a 00 00 00 03 01 83 02"),
    ],
)
def test_modbus(wire, request_bytes, reply):
    async def body(rig, reader, writer):
        writer.write(octets(request_bytes))
        assert await reader.readexactly(len(octets(reply))) == octets(reply)

    talk(wire, VALVES, body)


def test_modbus_requests_in_one_segment_and_in_pieces(wire):
    async def body(rig, reader, writer):
        both = octets(MODBUS["write_all"]["bytes"]) + octets(MODBUS["read_all"]["bytes"])
        writer.write(both)
        assert await reader.readexactly(12) == octets(MODBUS["write_all"]["reply"])
        assert len(await reader.readexactly(MODBUS["read_all"]["reply_length"])) == 105
        for byte in octets(MODBUS["watchdog"]["bytes"]):
            writer.write(bytes([byte]))
            await writer.drain()
            await asyncio.sleep(0.001)
        assert await reader.readexactly(12) == octets(MODBUS["watchdog"]["bytes"])

    talk(wire, VALVES, body)


@pytest.mark.parametrize(
    "garbage", ["00 01 00 05 00 06 01 03 00 00 00 01", "00 01 00 00 01 ff 01 03", "ff" * 20]
)
def test_what_is_no_modbus_ends_the_connection(wire, garbage):
    async def body(rig, reader, writer):
        writer.write(octets(garbage))
        with pytest.raises(ConnectionResetError):
            await reader.readexactly(1)

    talk(wire, VALVES, body)


def test_qtm_dialogue(wire):
    async def body(rig, reader, writer):
        welcome = octets(QTM["welcome"]["bytes"]) + QTM["welcome"]["text"].encode()
        assert await reader.readexactly(len(welcome)) == welcome
        writer.write(octets(QTM["version"]["bytes"]) + QTM["version"]["text"].encode())
        reply = octets("1c 00 00 00 01 00 00 00") + b"Version set to 1.25\0"
        assert await reader.readexactly(len(reply)) == reply
        writer.write(octets(QTM["stream"]["bytes"]) + QTM["stream"]["text"].encode())
        head = await reader.readexactly(40)
        assert head[:8] == octets("b8 00 00 00 03 00 00 00")
        assert head[20:40] == octets("01 00 00 00 a0 00 00 00 05 00 00 00 03 00 00 00 00 00 00 00")
        await reader.readexactly(184 - 40)
        rig.inject("qtm", "no_more_data")
        ends = octets(QTM["no_more_data"]["bytes"]) + octets("09 00 00 00 06 00 00 00 04")
        rest = b""
        while ends not in rest:
            rest += await reader.read(4096)

    talk(wire, MOCAP, body)


@pytest.mark.parametrize("garbage", ["00 00 00 00 01 00 00 00", "ff ff ff ff 01 00 00 00"])
def test_what_is_no_command_ends_the_connection(wire, garbage):
    async def body(rig, reader, writer):
        await reader.readexactly(35)
        writer.write(octets(garbage))
        with pytest.raises(ConnectionResetError):
            await reader.readexactly(1)

    talk(wire, MOCAP, body)
