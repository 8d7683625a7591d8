"""The Modbus link on a real socket, byte for byte as the manuals have it, and what peers do wrong."""

import asyncio
import contextlib
import struct
import time

import pytest

from softarm.drivers.errors import ConnectionLost, ProtocolError
from softarm.drivers.health import Health
from softarm.drivers.valves.link import ModbusExceptionError, NoAnswer
from softarm.drivers.valves.modbus import ModbusTcpLink
from softarm.drivers.valves.registers import MpaLayout


class Peer:
    """Records each request and answers by a script: with bytes, or with a function of the request."""

    def __init__(self, *script):
        self.script = list(script)
        self.requests = []
        self.server = None
        self.writers = []

    async def __aenter__(self):
        self.server = await asyncio.start_server(self.serve, "127.0.0.1", 0)
        self.health = Health()
        self.link = ModbusTcpLink(
            "valves",
            "127.0.0.1",
            self.server.sockets[0].getsockname()[1],
            unit=1,
            timeout_s=0.1,
            open_s=2.0,
            health=self.health,
        )
        await self.link.open()
        return self

    async def __aexit__(self, *_):
        self.link.close()
        self.server.close()
        for writer in self.writers:
            writer.close()
            with contextlib.suppress(ConnectionError):
                await writer.wait_closed()
        await self.server.wait_closed()

    async def serve(self, reader, writer):
        self.writers.append(writer)
        with contextlib.suppress(asyncio.IncompleteReadError, ConnectionError):
            while True:
                head = await reader.readexactly(6)
                request = head + await reader.readexactly(struct.unpack(">H", head[4:])[0])
                self.requests.append(request)
                answer = self.script.pop(0) if self.script else None
                if answer == "drop":
                    writer.transport.abort()
                    return
                if answer is not None:
                    writer.write(answer(request) if callable(answer) else answer)


def frame(request, pdu, *, transaction=None, protocol=0, unit=1):
    number = struct.unpack(">H", request[:2])[0] if transaction is None else transaction
    return struct.pack(">HHHB", number, protocol, len(pdu) + 1, unit) + pdu


def registers(words, function=3):
    def answer(request):
        return frame(request, struct.pack(f">BB{len(words)}H", function, 2 * len(words), *words))

    return answer


BLOCK = [350, 350, 0, 0xFFFF, 0, 31] + [0] * 42


async def test_read_all_is_the_vector(vectors):
    async with Peer(registers(BLOCK)) as peer:
        words = await peer.link.read(45395, 48)
        assert peer.requests[0] == bytes.fromhex(vectors["modbus"]["read_all"]["bytes"])
        inputs = MpaLayout().decode(words)
        assert (inputs.actual[:2], inputs.echo[:2], inputs.diagnosis[:2]) == ((350, -1), (350, 0), (0, 31))
        assert peer.health.round_trip.count == 1


async def test_write_all_is_the_vector(vectors):
    vector = vectors["modbus"]["write_all"]
    confirm = bytes.fromhex(vector["reply"])
    async with Peer(registers(BLOCK), confirm) as peer:
        await peer.link.read(45395, 48)
        await peer.link.write(40003, MpaLayout().encode(vector["words"]))
        assert peer.requests[1] == bytes.fromhex(vector["bytes"])


async def test_exchange_is_the_vector_and_its_refusal_is_told(vectors):
    vector = vectors["modbus"]["exchange_all"]
    refusal = bytes.fromhex(vector["exception_reply"])
    async with Peer(registers([0]), registers([0]), refusal) as peer:
        await peer.link.read(45395, 1)
        await peer.link.read(45395, 1)
        with pytest.raises(
            ModbusExceptionError, match="function 23 at register 40003 with exception 2"
        ) as caught:
            await peer.link.exchange(45395, 48, 40003, vector["words"])
        assert caught.value.code == vector["exception_code"]
        assert peer.requests[2] == bytes.fromhex(vector["bytes"])


async def test_the_watchdog_write_is_the_vector(vectors):
    vector = vectors["modbus"]["watchdog"]
    async with Peer(registers([0]), registers([0]), registers([0]), lambda request: request) as peer:
        for _ in range(3):
            await peer.link.read(45395, 1)
        await peer.link.write_one(46100, vector["milliseconds"])
        assert peer.requests[3] == bytes.fromhex(vector["bytes"])


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (registers([1, 2]), "2 registers instead of 3"),
        (registers([1, 2, 3], function=4), "function 4 to function 3"),
    ],
)
async def test_a_misfit_answer_is_rejected(answer, told):
    async with Peer(answer) as peer:
        with pytest.raises(ProtocolError, match=told):
            await peer.link.read(45395, 3)
        assert peer.health.rejected == 1


async def test_a_confirmation_of_other_registers_is_rejected():
    other = bytes.fromhex("000100000006011000010010")
    async with Peer(other) as peer:
        with pytest.raises(ProtocolError, match="at 1 instead"):
            await peer.link.write(40003, [0] * 16)


async def test_silence_ends_after_the_time_out_and_the_connection_stays():
    async with Peer(None, registers([7])) as peer:
        began = time.monotonic()
        with pytest.raises(NoAnswer, match=r"limit 0\.1 s"):
            await peer.link.read(45395, 1)
        assert 0.08 < time.monotonic() - began < 0.5
        assert await peer.link.read(45395, 1) == (7,)
        assert peer.health.timeouts == 1


async def test_a_late_answer_is_discarded_by_its_transaction():
    def late_then_right(request):
        return frame(request, b"\x03\x02\x00\x63", transaction=1) + registers([7])(request)

    async with Peer(None, late_then_right) as peer:
        with pytest.raises(NoAnswer):
            await peer.link.read(45395, 1)
        assert await peer.link.read(45395, 1) == (7,)


async def test_a_drop_fails_the_pending_request_at_once():
    async with Peer("drop") as peer:
        peer.link._client.ctx.comm_params.timeout_connect = 60.0
        with pytest.raises(ConnectionLost, match="dropped"):
            await asyncio.wait_for(peer.link.read(45395, 1), 5.0)
        assert not peer.link.connected
        with pytest.raises(ConnectionLost):
            await peer.link.read(45395, 1)


@pytest.mark.parametrize(
    "garbage", [b"\xff" * 9, b"\x00" * 40, b"\x00\x01\x00\x00\x00\x03\x01\x03\x55", b"GET /\r\n"]
)
async def test_garbage_never_passes_for_an_answer(garbage):
    async with Peer(garbage) as peer:
        with pytest.raises((ConnectionLost, ProtocolError, ModbusExceptionError)):
            await peer.link.read(45395, 1)


async def test_a_closed_port_is_told_with_its_address():
    link = ModbusTcpLink("valves", "127.0.0.1", 1, unit=1, timeout_s=0.1, open_s=2.0, health=Health())
    with pytest.raises(ConnectionLost, match=r"127\.0\.0\.1:1.*check address"):
        await link.open()
