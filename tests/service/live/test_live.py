"""A service and fakes as processes, over zenoh: from teaching to the death of each process, in this order."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from acceptance.processes import child_of
from acceptance.safety_processes import other_client
from softarm.recordings import load_recording
from softarm_client.session import client_settings, open_session
from tests.service.live.helpers import (
    PATIENCE_S,
    VENTED_MBAR,
    VENTED_S,
    cleared,
    collecting,
    later,
    pressurised,
    seconds_until_vented,
    setpoints,
    settled,
    still,
    wait_for_mode,
)

pytestmark = pytest.mark.timeout(240)  # the estimator compiles its kernels in a fresh checkout


HANDS = {"a": np.array([0.3, 0.12, 0.0]), "b": np.array([-0.1, 0.2, 0.0])}
NEAR_M = 0.008
"""The mean over poses and arms is half of this (docs/experiments.md)."""


def test_loop_and_devices_run_before_other_programs_and_the_estimator_does_not(rig, client):
    words = [
        sys.executable,
        "-c",
        "from softarm.common.real_time import raise_priority; raise_priority(); import os; ",
    ]
    words[-1] += "print(os.sched_getscheduler(0))"
    permitted = int(subprocess.run(words, capture_output=True, check=True).stdout)
    service = rig.service.process.pid
    policies = [os.sched_getscheduler(pid) for pid in (service, rig.fakes.process.pid)]
    assert policies == [permitted, permitted]
    assert os.sched_getscheduler(child_of(service)) == os.SCHED_OTHER


def test_poses_taught_by_hand_are_held_saved_and_found_again(client, fakes):
    taught, held, found = {}, {}, {}
    with client.lease(), collecting(client.states()) as states:
        hanging = still(client, fakes)
        for name, force in HANDS.items():
            if client.state().mode == "IDLE":
                client.arm()
            client.teach.start()
            pulled(client, fakes, force)
            taught[name] = still(client, fakes)
            client.teach.hold()
            settled(client)
            pulled(client, fakes, force, shares=(0.75, 0.5, 0.25, 0.0))
            held[name] = still(client, fakes)
            client.teach.save(name)
        for name in HANDS:
            client.teach.goto(name)
            settled(client)
            found[name] = still(client, fakes)
        client.teach.release()
        client.disarm()
        asked = np.array([state.asked_pa for state in states if state.mode == "HOLDING"])
    assert asked.max() > 5e3
    assert np.abs(np.diff(asked, axis=0)).max() < 8e3  # ramps, no jump, at twenty states a second
    assert set(client.teach.poses()) >= set(HANDS)
    for name in HANDS:
        assert from_tip(taught[name], hanging) > 3 * NEAR_M, name
        assert from_tip(held[name], taught[name]) < NEAR_M, name
        assert from_tip(found[name], taught[name]) < NEAR_M, name
    assert wait_for_mode(client, "IDLE").asked_pa == (0.0,) * 6


def pulled(client, fakes, force, shares=(0.25, 0.5, 0.75, 1.0)):
    """Let the hand change its force through a period of the arm's vibration, which leaves little of it."""
    for share in shares:
        fakes.ask("hand", section="tip", force_n=(share * force).tolist())
        later(client, 0.1)


def from_tip(one, other):
    """Distance of the tips of two true poses [m]."""
    return np.linalg.norm(one[0][-1] - other[0][-1])


def test_recording_from_the_command_line(rig, client):
    command = [sys.executable, "-m", "softarm", "record", "--arm", rig.settings.arm, "--name", "cli"]
    words = ["--endpoint", rig.settings.endpoint, "--seconds", "3", "--json"]
    done = subprocess.run([*command, *words], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(done.stdout)["rows"]
    recording = load_recording(Path(row["file"]))
    assert 2.5 < recording.time[-1] - recording.time[0] < 6.0
    assert set(recording.chambers) == set(range(6))
    assert {"intermediate", "tip"} <= set(recording.frames)
    assert np.isfinite(recording.columns["estimate_frame_tip_z_std_m"]).any()
    assert {"surface", "force/tip"} <= set(drawn_in(Path(row["file"])))


def drawn_in(path):
    """Names of what a viewer draws of a recording, read by Foxglove's own schemas."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for decoded in reader.iter_decoded_messages(topics=["/scene"]):
            yield from (entity.id for entity in decoded.decoded_message.entities)


def test_a_push_is_felt_and_its_end_as_well(client, fakes):
    client.tare()
    with collecting(client.events()) as events:
        fakes.ask("hand", section="tip", force_n=[0.3, 0.0, 0.0])
        felt = client.estimates().wait_for(lambda e: e.contact is not None and settles(e), PATIENCE_S)
        fakes.ask("hand")
        ended = client.events().wait_for(lambda e: e.kind == "contact_end", PATIENCE_S)
    assert felt.in_contact
    assert felt.contact.height_std_m > 0.0
    assert felt.contact.height_m > 0.2  # the tip is at 0.276 m
    begun = [event for event in events if event.kind == "contact_begin"]
    assert begun
    assert begun[0].stamp.sequence < ended.stamp.sequence


def settles(estimate):
    """Return whether the force at the tip is near 0.3 N; while the arm still swings it is not."""
    force = next(load.force_n[0] for load in estimate.loads if load.section == "tip")
    return abs(force - 0.3) < 0.1


CALM_N2 = 0.01
"""Sum of the forces' variances that no push of a moment ago has raised; at rest it is a tenth of that."""


def test_without_motion_capture_the_bend_sensors_carry_on(client, fakes):
    whole = client.estimates().wait_for(lambda e: spread(e) < CALM_N2, PATIENCE_S)
    fakes.ask("fault", device="qtm", fault="silence", for_s=20.0)
    alone = client.estimates().wait_for(lambda e: e.status == "degraded", PATIENCE_S)
    assert set(alone.sensors_lost) == {"orientation_intermediate", "orientation_tip"}
    assert set(alone.sensors_used) == {"bend_intermediate", "bend_tip"}
    lost = ("stale_sensor", "orientation_tip")  # the state that says so comes after the estimate
    client.states().wait_for(lambda s: lost in {(f.code, f.where) for f in s.findings}, PATIENCE_S)
    late = client.estimates().wait_for(lambda e: spread(e) > 1.02 * spread(whole), PATIENCE_S)
    assert late.status == "degraded"
    fakes.ask("clear")
    client.estimates().wait_for(lambda e: e.status == "converged", PATIENCE_S)


def spread(estimate):
    return sum(np.nansum(np.diag(np.array(load.covariance_n2, dtype=float))) for load in estimate.loads)


BAD = {
    "no json": (b"{", "disarm", "malformed"),
    "no such verb": (b"{}", "dance", "malformed"),
    "late": ({"deadline_unix_ns": 1}, "disarm", "stale"),
    "lease of nobody": ({"lease": "guess"}, "disarm", "lease_held"),
    "too much": ({"pressures_pa": [9e5] * 6, "lifetime_s": 1.0}, "set_pressures", "out_of_limit"),
    "not a number": ({"pressures_pa": [float("nan")] * 6, "lifetime_s": 1.0}, "set_pressures", None),
    "too few": ({"pressures_pa": [0.0], "lifetime_s": 1.0}, "set_pressures", None),
    "wrong mode": ({"name": "a"}, "experiment/end", None),
}


def test_bad_commands_get_a_typed_reply_in_time_move_nothing_and_are_logged_once(rig, client):
    session = open_session(client_settings(rig.settings.endpoint))
    log = rig.folder / "service.log"
    try:
        with pressurised(client):
            before = client.state()
            for name, (fields, verb, code) in BAD.items():
                lines = log.read_text().count("refused (")
                begin = time.monotonic()
                reply = send(session, client, verb, fields)
                assert time.monotonic() - begin < 1.0, name
                assert code in (None, reply["code"]), (name, reply)
                assert reply["hint"], name
                while (told := log.read_text().count("refused (")) == lines:
                    assert time.monotonic() - begin < 2.0, name
                assert told == lines + 1, name
            after = client.state()
            assert after.mode == before.mode == "ARMED"
            assert after.asked_pa == before.asked_pa
    finally:
        session.close()


def next_sequence(client):
    client._sequence += 1  # the test speaks past the client and must not overtake it
    return client._sequence


def send(session, client, verb, fields):
    if not isinstance(fields, bytes):
        request = {
            "deadline_unix_ns": time.time_ns() + 10**9,
            "sequence": next_sequence(client),
            "client": "bad",
            "lease": client._lease,  # the test speaks past the client, with the client's lease
        }
        fields = json.dumps({k: v for k, v in (request | fields).items() if k != "name"}).encode()
    (reply,) = session.get(client.keys.command(verb), payload=fields, timeout=1.0)
    return json.loads(bytes(reply.err.payload))


def test_stalled_subscriber_holds_up_nobody(rig, client):
    with other_client(rig.settings, "listen") as process, collecting(client.states()) as states:
        process.send_signal(signal.SIGSTOP)
        later(client, 2.0)
        assert len(states) > 25
        gaps = np.diff([state.stamp.monotonic_ns for state in states]) * 1e-9
        assert gaps.max() < 0.5


def test_killed_holder_of_the_lease_leaves_the_arm_vented(rig, client, fakes):
    with other_client(rig.settings, "lease") as process:
        wait_for_mode(client, "ARMED")
        process.kill()
        state = wait_for_mode(client, "IDLE")
    assert state.asked_pa == (0.0,) * 6
    assert seconds_until_vented(fakes) < VENTED_S


@pytest.mark.parametrize(
    ("device", "fault", "mode"),
    [
        ("valves", "node_down", "ARMED"),
        ("valves", "freeze", "ARMED"),
        ("valves", "second_master", "TEACH"),
        ("qtm", "silence", "HOLDING"),
        ("qtm", "body_lost", "TEACH"),
    ],
)
def test_device_faults_vent_in_time_and_nothing_arms_again(
    client, fakes, provokes_a_fault, device, fault, mode
):
    with pressurised(client, mode):
        fakes.ask("fault", device=device, fault=fault, for_s=0.6)
        assert seconds_until_vented(fakes) < VENTED_S
        wait_for_mode(client, "FAULTED")
        assert later(client, 0.8).mode == "FAULTED"
        assert setpoints(fakes) == VENTED_MBAR
        cleared(client)


@pytest.mark.parametrize(
    ("mode", "payload"), [("ARMED", None), ("TEACH", b"\xff\x00 no JSON {"), ("HOLDING", b"[" * 20_000)]
)
def test_stop_vents_the_running_service_whatever_it_carries(
    rig, client, fakes, provokes_a_fault, mode, payload
):
    session = open_session(client_settings(rig.settings.endpoint))
    try:
        with pressurised(client, mode):
            assert setpoints(fakes) != VENTED_MBAR
            (reply,) = session.get(client.keys.command("stop"), payload=payload, timeout=2.0)
            answer = json.loads(bytes(reply.ok.payload))
            assert (answer["verb"], answer["mode"]) == ("stop", "FAULTED")
            assert seconds_until_vented(fakes) < VENTED_S
            assert "stopped by" in wait_for_mode(client, "FAULTED").fault_cause
            assert later(client, 0.5).mode == "FAULTED"
            assert setpoints(fakes) == VENTED_MBAR
            cleared(client)
    finally:
        session.close()


def test_frozen_loop_vents_by_the_terminal_and_is_said(rig, client, fakes, provokes_a_fault):
    with pressurised(client):
        process = rig.service.process
        process.send_signal(signal.SIGSTOP)
        try:
            assert seconds_until_vented(fakes) < VENTED_S
        finally:
            process.send_signal(signal.SIGCONT)
        state = wait_for_mode(client, "FAULTED")
        assert state.fault_cause
    cleared(client)
