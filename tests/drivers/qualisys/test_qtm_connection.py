"""One connection to QTM: each reply reaches whoever asked, and nobody waits for a peer that is gone."""

import asyncio
from typing import Any

import pytest

from softarm.drivers.errors import ConnectionLost
from softarm.drivers.qualisys.connection import QtmConnection, QtmError
from softarm.drivers.qualisys.packets import PacketKind
from tests.drivers.qualisys.qtm_peer import Peer, event, frame, text


def connected(virtual: Any) -> tuple[Peer, QtmConnection]:
    peer = Peer()
    connection = QtmConnection("mocap", virtual.clock)
    peer.connect(connection)
    return peer, connection


def test_open_requests_fail_at_once_when_the_connection_is_lost(virtual: Any) -> None:
    async def main() -> None:
        peer, connection = connected(virtual)
        await connection.welcome()
        peer.mute = True
        asking = [
            asyncio.create_task(connection.request("QTMVersion", PacketKind.COMMAND)),
            asyncio.create_task(connection.request("GetParameters 6D", PacketKind.XML)),
        ]
        await asyncio.sleep(0)
        connection.connection_lost(ConnectionResetError("reset by peer"))
        before = virtual.clock()
        outcomes = await asyncio.gather(*asking, return_exceptions=True)
        assert virtual.clock() == before
        assert all(isinstance(outcome, ConnectionLost) for outcome in outcomes)
        with pytest.raises(ConnectionLost, match="reset by peer"):
            await connection.request("QTMVersion", PacketKind.COMMAND)

    virtual.run(main)


def test_the_answer_of_a_request_that_was_given_up_reaches_nobody_else(virtual: Any) -> None:
    async def main() -> None:
        peer, connection = connected(virtual)
        await connection.welcome()
        peer.mute = True
        given_up = asyncio.create_task(connection.request("QTMVersion", PacketKind.COMMAND))
        await asyncio.sleep(0)
        given_up.cancel()
        refused = asyncio.create_task(connection.request("Version 9.9", PacketKind.COMMAND))
        wanted = asyncio.create_task(connection.request("ByteOrder", PacketKind.COMMAND))
        await asyncio.sleep(0)
        peer.send(text(1, "late") + text(0, "Version NOT supported") + text(1, "Byte order is little endian"))
        assert b"little endian" in await wanted
        with pytest.raises(QtmError, match="Version NOT supported"):
            await refused

    virtual.run(main)


def test_data_never_answers_a_request(virtual: Any) -> None:
    async def main() -> None:
        peer, connection = connected(virtual)
        await connection.welcome()
        peer.answers["QTMVersion"] = lambda: frame(1, 1.0) + event(11) + text(1, "QTM Version is 2.3")
        assert b"2.3" in await connection.request("QTMVersion", PacketKind.COMMAND)

    virtual.run(main)
