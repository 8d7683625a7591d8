import asyncio
import json
import re
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest
import trustme

from softarm.daemon.network.bus import Bus
from softarm.daemon.network.router import open_router
from softarm_client import Arm
from softarm_client.commands import Applied
from softarm_client.errors import CommandRefusedError, SetupError, UnreachableError
from softarm_client.messages import Event, Stamp
from softarm_client.session import NetworkSettings, client_settings, open_session
from tests.service.network.served import ServedArm
from tests.service.standins import listening_endpoint, mismatch

EXAMPLES = Path(__file__).parents[2] / "deploy" / "zenoh"
EVENT = Event(
    stamp=Stamp(sequence=1, monotonic_ns=0, unix_ns=0, source="fake"),
    kind="mode",
    where="test",
    text="a test",
)
MESSAGE = mismatch(7)


@pytest.fixture
async def serve():
    """Start a bus on an example configuration that answers every command."""
    buses, tasks = [], []

    async def start(path, endpoint):
        bus = Bus(NetworkSettings(listen=(endpoint,), zenoh_config=path), "a", asyncio.get_running_loop())
        bus.open({"config": b"{}"}, stopped)
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


def stopped(call):
    call.answer(Applied(verb=call.verb, mode="FAULTED", applied={}))


def visit(endpoint, config):
    """Do what a client may want to; tell which of it worked."""
    with Arm("a", endpoint, zenoh_config=config) as client:
        try:
            commanded = client.command("stop").verb == "stop"
        except CommandRefusedError:
            commanded = False
        seen = client.mismatches().wait_for(lambda _: True, 5.0).stamp.sequence
        return {"config": client.ask("config"), "commanded": commanded, "seen": seen, "alive": client.alive()}


def with_users(name, folder):
    """Write an example with its users and passwords, listening on a free port of this host."""
    (folder / "users.txt").write_text("service:s\noperator:o\nviewer:v\n")
    text = (EXAMPLES / name).read_text().replace("CHANGE-ME", "s")
    (folder / name).write_text(text.replace("tcp/0.0.0.0:7447", "tcp/127.0.0.1:0"))
    return folder / name


def as_user(user, folder, password=None):
    """Write the credentials of a user as ``deploy/zenoh/client.json5`` has them."""
    path = folder / f"{user}-client.json5"
    text = (EXAMPLES / "client.json5").read_text()
    path.write_text(text.replace("operator", user).replace("CHANGE-ME", password or user[0]))
    return path


@pytest.fixture(params=["users.json5", "router.json5"])
def guarded(request, tmp_path):
    """An arm with users, by itself and behind the router: its endpoint and who serves it."""
    with ExitStack() as stack:
        config = with_users(request.param, tmp_path)
        settings = NetworkSettings(listen=("tcp/127.0.0.1:0",), zenoh_config=config)
        endpoint = None
        if request.param == "router.json5":
            router = open_router(config)
            stack.callback(router.close)
            endpoint = listening_endpoint(router)
            service = as_user("service", tmp_path)
            settings = NetworkSettings(mode="client", listen=(), connect=(endpoint,), zenoh_config=service)
        arm = stack.enter_context(ServedArm(tmp_path, settings, endpoint))
        yield arm


def test_viewer_sees_everything_and_cannot_command(guarded, tmp_path):
    with Arm("test", guarded.endpoint, zenoh_config=as_user("viewer", tmp_path)) as viewer:
        assert viewer.alive()
        assert viewer.ask("config") == "{}"
        seen = {name: threading.Event() for name in ("event", "mismatch", "shape")}
        with (
            viewer.events().subscribe(lambda _: seen["event"].set()),
            viewer.mismatches().subscribe(lambda _: seen["mismatch"].set()),
            viewer.subscribe_shape(lambda _: seen["shape"].set()),
        ):
            until(lambda: guarded.in_loop(lambda: guarded.bus.shape_wanted))
            until(lambda: guarded.publish(EVENT, MESSAGE) and all(e.wait(0.05) for e in seen.values()))
        for verb in ("lease/acquire", "stop", "clear"):
            with pytest.raises(CommandRefusedError):
                viewer.command(verb)
        assert guarded.mode == "IDLE"


def test_operator_commands_and_neither_overhears_nor_forges(guarded, tmp_path):
    """A lease token goes to the service alone, and a state comes from the service alone."""
    config, heard, states = as_user("operator", tmp_path), [], []
    spy = open_session(client_settings(guarded.endpoint, config))
    with Arm("test", guarded.endpoint, zenoh_config=config) as client:
        try:
            listeners = [
                declare(key, lambda message: heard.append(str(message.key_expr)))
                for key in ("softarm/@v1/**", "softarm/@v1/test/command/**", "**")
                for declare in (spy.declare_queryable, spy.declare_subscriber)
            ]
            with client.mismatches().subscribe(states.append), client.lease():
                assert client.arm().mode == "ARMED"
                forged = MESSAGE.model_copy(update={"advice": "forged"}).model_dump_json()
                for _ in range(20):
                    spy.put("softarm/@v1/test/mismatch", forged)
                until(lambda: guarded.publish(EVENT, MESSAGE) and states)
                assert client.stop().mode == "FAULTED"
        finally:
            spy.close()
    assert len(listeners) == 6
    assert [key for key in heard if "/command/" in key] == []
    assert "forged" not in {state.advice for state in states}


@pytest.fixture
def impatient(monkeypatch):
    """Let clients try for one second instead of three."""
    monkeypatch.setattr("softarm_client.session.CONNECT_MS", 1000)


def test_whoever_has_no_password_is_kept_out(guarded, impatient, tmp_path):
    strangers = [as_user("viewer", tmp_path, "wrong"), as_user("nobody", tmp_path, "n"), None]

    def refused(config):
        with pytest.raises(UnreachableError, match="no zenoh session"):
            Arm("test", guarded.endpoint, zenoh_config=config)
        return True

    with ThreadPoolExecutor(len(strangers)) as at_once:
        assert all(at_once.map(refused, strangers))


def until(accept, within=10.0):
    deadline = time.monotonic() + within
    while not accept():
        assert time.monotonic() < deadline
        threading.Event().wait(0.02)


def test_router_without_users_is_refused_beyond_this_host(tmp_path):
    path = tmp_path / "open.json5"
    path.write_text('{ listen: { endpoints: ["tcp/0.0.0.0:0"] } }')
    with pytest.raises(SetupError, match="gives everybody"):
        open_router(path)
    with open_router(path, allow_unauthenticated=True) as session:
        assert not session.is_closed()


def test_credentials_handed_over_by_systemd_are_used(tmp_path, monkeypatch):
    handed, etc = tmp_path / "credentials", tmp_path / "etc"
    handed.mkdir()
    etc.mkdir()
    with_users("users.json5", handed)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(handed))
    settings = NetworkSettings(listen=("tcp/127.0.0.1:0",), zenoh_config=etc / "users.json5")
    with ServedArm(tmp_path, settings) as arm:
        monkeypatch.delenv("CREDENTIALS_DIRECTORY")
        with Arm("test", arm.endpoint, zenoh_config=as_user("operator", tmp_path)) as client:
            assert client.stop().mode == "FAULTED"


def own_endpoint(bus):
    return listening_endpoint(bus.session)


async def test_tls_wants_a_certificate(serve, impatient, tmp_path):
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
    with pytest.raises(UnreachableError, match="no zenoh session"):
        await asyncio.to_thread(visit, f"tls/localhost:{port}", bare)
