import asyncio
import json
import re
from pathlib import Path

import pytest
import trustme

from softarm.api.commands import Applied
from softarm.api.messages import Mismatch, Stamp
from softarm.client.client import CommandRefusedError, SoftarmClient
from softarm.client.session import NetworkSettings, listening_endpoint
from softarm.daemon.network.bus import Bus
from softarm.estimator.errors import InputError

EXAMPLES = Path(__file__).parents[2] / "deploy" / "zenoh"
MESSAGE = Mismatch(
    stamp=Stamp(sequence=7, monotonic_ns=0, unix_ns=0, source="fake"),
    consistent=True,
    since_unix_ns=None,
    where=(),
    normalised_innovation_squared=None,
    recording=None,
    advice="none",
)


@pytest.fixture
async def serve():
    """Start a bus on an example configuration that answers every command."""
    buses, tasks = [], []

    async def start(path, endpoint):
        bus = Bus(NetworkSettings(listen=(endpoint,), zenoh_config=path), "a", asyncio.get_running_loop())
        bus.open({"config": lambda: b"{}"})
        bus.publish("mismatch", MESSAGE)
        buses.append(bus)
        tasks.append(asyncio.create_task(answer(bus)))
        return bus

    async def answer(bus):
        while True:
            call = await bus.next_call()
            call.answer(Applied(verb=call.verb, mode="IDLE", applied={}))

    yield start
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    for bus in buses:
        bus.close()


def visit(endpoint, config):
    """Do what a client may want to; tell which of it worked."""
    with SoftarmClient("a", endpoint, zenoh_config=config) as client:
        try:
            commanded = client.command("stop").verb == "stop"
        except CommandRefusedError:
            commanded = False
        seen = client.wait_for("mismatch", Mismatch, lambda _: True, 5.0).stamp.sequence
        return {"config": client.ask("config"), "commanded": commanded, "seen": seen, "alive": client.alive()}


async def test_viewer_watches_and_cannot_command(serve, tmp_path):
    users = tmp_path / "users.txt"
    users.write_text("service:s\noperator:o\nviewer:v\n")
    example = (EXAMPLES / "users.json5").read_text()
    config = tmp_path / "users.json5"
    config.write_text(example.replace("/etc/softarm/users.txt", str(users)).replace("CHANGE-ME", "s"))
    bus = await serve(config, "tcp/127.0.0.1:0")
    port = re.search(r":(\d+)$", await asyncio.to_thread(own_endpoint, bus)).group(1)

    def as_user(user, password):
        path = tmp_path / f"{user}-{password}.json5"
        path.write_text(json.dumps({"transport": {"auth": {"usrpwd": {"user": user, "password": password}}}}))
        return visit(f"tcp/127.0.0.1:{port}", path)

    every = {"config": "{}", "seen": 7, "alive": True}
    assert await asyncio.to_thread(as_user, "operator", "o") == every | {"commanded": True}
    assert await asyncio.to_thread(as_user, "viewer", "v") == every | {"commanded": False}
    with pytest.raises(InputError, match="no zenoh session"):
        await asyncio.to_thread(as_user, "viewer", "wrong")


def own_endpoint(bus):
    return listening_endpoint(bus.session)


async def test_tls_wants_a_certificate(serve, tmp_path):
    authority = trustme.CA()
    authority.cert_pem.write_to_path(str(tmp_path / "ca.pem"))
    issued = authority.issue_cert("localhost")
    issued.private_key_pem.write_to_path(str(tmp_path / "service.key"))
    issued.cert_chain_pems[0].write_to_path(str(tmp_path / "service.pem"))
    config = tmp_path / "tls.json5"
    config.write_text((EXAMPLES / "tls.json5").read_text().replace("/etc/softarm/tls/", f"{tmp_path}/"))
    bus = await serve(config, "tls/localhost:0")
    port = re.search(r":(\d+)$", await asyncio.to_thread(own_endpoint, bus)).group(1)
    answers = await asyncio.to_thread(visit, f"tls/localhost:{port}", config)
    assert answers["commanded"]
    bare = tmp_path / "bare.json5"
    bare.write_text(
        json.dumps({"transport": {"link": {"tls": {"root_ca_certificate": str(tmp_path / "ca.pem")}}}})
    )
    with pytest.raises(InputError, match="no zenoh session"):
        await asyncio.to_thread(visit, f"tls/localhost:{port}", bare)


async def test_router_carries_the_keys(tmp_path):
    config = tmp_path / "router.json5"
    example = (EXAMPLES / "router.json5").read_text()
    config.write_text(example.replace("tcp/0.0.0.0:7447", "tcp/127.0.0.1:0"))
    router = Bus(
        NetworkSettings(mode="router", listen=("tcp/127.0.0.1:0",), zenoh_config=config),
        "none",
        asyncio.get_running_loop(),
    )
    router.open({})
    endpoint = await asyncio.to_thread(own_endpoint, router)
    behind = NetworkSettings(mode="client", listen=(), connect=(endpoint,))
    bus = Bus(behind, "a", asyncio.get_running_loop())
    await asyncio.to_thread(bus.open, {"config": lambda: b"{}"})
    bus.publish("mismatch", MESSAGE)

    async def answer():
        call = await bus.next_call()
        call.answer(Applied(verb=call.verb, mode="IDLE", applied={}))

    task = asyncio.create_task(answer())
    answers = await asyncio.to_thread(visit, endpoint, None)
    await task
    bus.close()
    router.close()
    assert answers == {"config": "{}", "seen": 7, "alive": True, "commanded": True}
