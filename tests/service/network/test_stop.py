"""Nothing keeps ``stop`` from stopping the arm."""

import json
import threading

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from softarm.daemon.network.bus import COMMANDS_WAITING, LARGEST_REQUEST_BYTES
from softarm.daemon.safety.modes import TRANSITIONS, Mode, Trigger
from softarm_client.commands import sender
from tests.service.network.served import Sender, ServedArm


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    with ServedArm(tmp_path_factory.mktemp("arm")) as arm:
        yield arm


@pytest.fixture(scope="module")
def client(arm):
    with Sender(arm.endpoint) as client:
        yield client


def lead_to(arm, mode):
    """Fire the shortest sequence of events that leads from FAULTED to a mode."""
    paths = {Mode.FAULTED: ()}
    while mode not in paths:
        for (before, event), after in TRANSITIONS.items():
            if before in paths and after not in paths and event is not Trigger.SHUT_DOWN:
                paths[after] = (*paths[before], event)
    arm.controller.fire(Trigger.FAULT, "test")
    for event in paths[mode]:
        arm.controller.fire(event, "test")
    if arm.valves.armed:
        arm.valves.command((20e3,) * 6, 1.0)


REQUESTS = st.dictionaries(
    st.sampled_from(["deadline_unix_ns", "sequence", "client", "lease", "hurry"]),
    st.none() | st.integers() | st.text(max_size=100) | st.lists(st.integers(), max_size=3),
).map(lambda fields: json.dumps(fields).encode())


@settings(max_examples=150, deadline=None)
@example(payload=None)
@example(payload=b"")
@example(payload=b"{}")
@example(payload=b"[" * 10_000)
@example(payload=b"\x00" * 2**20)
@example(payload=json.dumps({"client": "x" * 90}).encode())
@given(payload=st.none() | st.binary(max_size=200) | REQUESTS)
def test_stop_stops_whatever_bytes_it_carries(arm, client, payload):
    arm.in_loop(lambda: lead_to(arm, Mode.ARMED))
    answer = client.raw("stop", payload)
    assert answer["verb"] == "stop"
    assert answer["mode"] == "FAULTED"
    assert arm.mode is Mode.FAULTED
    assert arm.valves.pressures == (0.0,) * 6
    assert not arm.valves.armed


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode not in (Mode.STARTING, Mode.STOPPING)])
def test_stop_stops_in_every_mode(arm, client, mode):
    arm.in_loop(lambda: lead_to(arm, mode))
    assert arm.mode is mode
    assert client.raw("stop", None)["mode"] == "FAULTED"
    assert arm.valves.pressures == (0.0,) * 6


def test_stop_of_every_arm_at_once_stops_this_one(arm, client):
    arm.in_loop(lambda: lead_to(arm, Mode.ARMED))
    assert client.raw("stop", None, key="softarm/@v1/*/command/stop")["mode"] == "FAULTED"


def test_stop_passes_a_full_inbox_and_what_waits_there_cannot_undo_it(arm, client):
    arm.in_loop(lambda: lead_to(arm, Mode.FAULTED))
    lease = client.send("lease/acquire")["applied"]["lease"]
    busy, resume, answers = threading.Event(), threading.Event(), []

    def send(verb):
        with Sender(arm.endpoint) as other:
            answers.append(other.send(verb, lease=lease))

    def block():
        busy.set()
        resume.wait(20.0)

    arm.loop.call_soon_threadsafe(block)  # as a callback that takes long would
    assert busy.wait(20.0)
    threads = [threading.Thread(target=send, args=("clear",)) for _ in range(COMMANDS_WAITING + 2)]
    for thread in threads:
        thread.start()
    while len(answers) < 2:  # the inbox is full: what comes on top is refused at once
        threading.Event().wait(0.01)
    assert {answer["code"] for answer in answers} == {"busy"}
    stopping = threading.Thread(target=lambda: answers.append(client.raw("stop", b"")))
    seen = arm.bus.stops_seen
    stopping.start()
    while arm.bus.stops_seen == seen:
        threading.Event().wait(0.01)
    resume.set()
    for thread in (*threads, stopping):
        thread.join()
    codes = [answer["code"] for answer in answers if answer["verb"] == "clear"]
    assert codes.count("stale") == COMMANDS_WAITING
    assert [answer["mode"] for answer in answers if answer["verb"] == "stop"] == ["FAULTED"]
    assert arm.mode is Mode.FAULTED
    assert client.send("clear", lease=lease)["mode"] == "IDLE"
    client.send("lease/release", lease=lease)


def test_large_request_is_refused_before_it_is_parsed(arm, client):
    answer = client.raw("disarm", b" " * (LARGEST_REQUEST_BYTES + 1))
    assert answer["code"] == "malformed"
    assert str(LARGEST_REQUEST_BYTES) in answer["message"]
    assert client.raw("disarm", b" " * LARGEST_REQUEST_BYTES)["message"].startswith("payload: Invalid JSON")


@given(payload=st.binary(max_size=100) | REQUESTS)
@example(payload=b'{"client": "<script>"}')
def test_name_of_a_sender_is_plain(payload):
    name = sender(payload)
    assert 1 <= len(name) <= 40
    assert not set(name) & set("<>&\"'`|\n")


def test_name_of_a_sender_is_read():
    assert sender(b'{"client": "operator page", "hurry": 1}') == "operator page"
