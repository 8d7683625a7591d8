import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from softarm.daemon.network.bus import COMMANDS_WAITING, Bus
from softarm.daemon.network.inbox import Inbox
from softarm_client import Arm
from softarm_client.commands import Applied, Refused
from softarm_client.errors import CommandRefusedError, UnreachableError
from softarm_client.session import NetworkSettings
from tests.service.standins import listening_endpoint, mismatch

STOPPED = Applied(verb="stop", mode="FAULTED", applied={"asked_pa": [0.0]})
FREE_PORT = NetworkSettings(listen=("tcp/127.0.0.1:0",))


@pytest.fixture
async def bus():
    with Bus(FREE_PORT, "test", asyncio.get_running_loop()) as bus:
        bus.open({"config": b'{"arm": "test"}', "surface": None}, lambda call: call.answer(STOPPED))
        yield bus


@pytest.fixture
async def client(bus):
    endpoint = await asyncio.to_thread(listening_endpoint, bus.session)
    client = await asyncio.to_thread(Arm, "test", endpoint)
    yield client
    await asyncio.to_thread(client.close)


async def test_command_gets_its_one_answer(bus, client):
    asked = asyncio.create_task(asyncio.to_thread(client.command, "clear"))
    call = await bus.next_call()
    assert call.verb == "clear"
    call.answer(Applied(verb="clear", mode="IDLE", applied={"cleared": "test"}))
    assert (await asked).applied == {"cleared": "test"}


async def test_stop_is_answered_past_the_inbox(bus, client):
    assert await asyncio.to_thread(client.command, "stop") == STOPPED


async def test_refusal_carries_code_and_hint(bus, client):
    asked = asyncio.create_task(asyncio.to_thread(client.command, "clear"))
    call = await bus.next_call()
    call.answer(Refused(verb="clear", code="wrong_mode", message="no", hint="stop first"))
    with pytest.raises(CommandRefusedError, match="stop first") as refusal:
        await asked
    assert refusal.value.refusal.code == "wrong_mode"


async def test_late_joiner_gets_the_last_message(bus, client):
    for sequence in range(3):
        bus.publish("mismatch", mismatch(sequence))
    message = await asyncio.to_thread(client.mismatches().newest)
    assert message.stamp.sequence == 2


async def test_slow_value_is_served(bus, client):
    assert await asyncio.to_thread(client.ask, "config") == '{"arm": "test"}'


async def test_the_surface_is_refused_until_the_estimator_has_brought_it(bus, client):
    with pytest.raises(CommandRefusedError, match="has not been built yet") as refusal:
        await asyncio.to_thread(client.ask, "surface")
    assert refusal.value.refusal.code == "not_available"
    bus.provide("surface", b"{}")
    assert await asyncio.to_thread(client.ask, "surface") == "{}"


async def test_alive_and_second_service_refused(bus, client):
    assert await asyncio.to_thread(client.alive)
    endpoint = await asyncio.to_thread(listening_endpoint, bus.session)
    second = NetworkSettings(listen=("tcp/127.0.0.1:0",), connect=(endpoint,))
    other = Bus(second, "test", asyncio.get_running_loop())
    with pytest.raises(UnreachableError, match="already served"):
        await asyncio.to_thread(other.open, {}, print)


async def test_taken_address_is_named(bus):
    endpoint = await asyncio.to_thread(listening_endpoint, bus.session)
    other = Bus(NetworkSettings(listen=(endpoint,)), "other", asyncio.get_running_loop())
    with pytest.raises(UnreachableError, match="address is free"):
        await asyncio.to_thread(other.open, {}, print)


async def test_burst_beyond_the_inbox_is_refused_as_busy(bus, client):
    def send():
        try:
            return client.command("clear", timeout_s=5.0).verb
        except CommandRefusedError as error:
            return error.refusal.code

    loop, pool = asyncio.get_running_loop(), ThreadPoolExecutor(COMMANDS_WAITING + 4)
    senders = [loop.run_in_executor(pool, send) for _ in range(COMMANDS_WAITING + 4)]
    done, waiting = set(), set(senders)
    while len(done) < 4:
        finished, waiting = await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        done |= finished
    assert {task.result() for task in done} == {"busy"}
    for _ in waiting:
        (await bus.next_call()).answer(Applied(verb="clear", mode="IDLE", applied={}))
    assert await asyncio.gather(*waiting) == ["clear"] * COMMANDS_WAITING


async def test_inbox_refuses_beyond_its_capacity_and_after_closing():
    inbox = Inbox(asyncio.get_running_loop(), capacity=2)
    accepted = []
    thread = threading.Thread(target=lambda: accepted.extend(inbox.offer(n) for n in range(3)))
    thread.start()
    thread.join()
    assert accepted == [True, True, False]
    assert [await inbox.take(), await inbox.take()] == [0, 1]
    assert inbox.offer(7)
    assert inbox.close() == (7,)
    assert not inbox.offer(8)
