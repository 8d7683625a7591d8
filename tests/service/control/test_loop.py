"""The control loop itself, in virtual time and on stand-ins of its dependencies."""

import asyncio
import itertools
import json
import logging
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from softarm.daemon.control import command_handler
from softarm.daemon.control.dependencies import Clocks, LoopDependencies
from softarm.daemon.control.host_watch import HostLoad, HostWatch
from softarm.daemon.control.lateness import pressure_files, read_pressure
from softarm.daemon.control.poses import PoseStore
from softarm.daemon.control.tick import Tick, Ticker, TickSchedule
from softarm.daemon.estimation.worker import WorkerState
from softarm.daemon.loop import ControlLoop
from softarm.daemon.safety.modes import Mode
from softarm.daemon.safety.observation import DeviceStatus
from softarm_client.commands import VERBS, Applied
from tests.service.standins import Estimator, Instruments, setup_in

TICK_NS = 10_000_000
UNIX_NS = 10**18


class MessageSink:
    shape_wanted = False

    def __init__(self):
        self.messages, self.shapes = [], []

    def publish(self, stream, message):
        self.messages.append((stream, message))

    def publish_shape(self, nodes):
        self.shapes.append(nodes)

    def of(self, stream):
        return [message for name, message in self.messages if name == stream]


class Arm:
    """A control loop whose clock the test moves."""

    def __init__(self, folder, clocks=None, host=HostLoad):
        self.now_ns, self.index, self.sequence, self.lease = 10**9, 0, 0, None
        self.sink, self.ready = MessageSink(), []
        clocks = clocks or Clocks(lambda: self.now_ns, lambda: UNIX_NS)
        self.loop = ControlLoop(
            setup_in(folder),
            LoopDependencies(
                lambda readings: Instruments(readings, clocks.monotonic_ns),
                Estimator,
                self.sink,
                "",
                lambda: self.ready.append(self.loop.mode),
                clocks,
                host,
            ),
        )

    @property
    def instruments(self):
        return self.loop.instruments

    def step(self, count=1, drift_ns=0):
        for _ in range(count):
            self.index += 1
            self.now_ns += TICK_NS
            self.instruments.read()
            self.loop.step(Tick(self.index, self.now_ns - drift_ns, drift_ns, 0, drift_ns))

    async def send(self, verb, client="ann", **fields):
        self.sequence += 1
        request = {"deadline_unix_ns": UNIX_NS + 1, "sequence": self.sequence, "client": client, **fields}
        if "lease" in VERBS[verb].model_fields and self.lease:
            request["lease"] = self.lease
        answer = await self.loop.answer(verb, json.dumps(request).encode())
        if verb == "lease/acquire":
            self.lease = answer.applied["lease"]
        return answer

    async def demand(self, *verbs):
        for verb in verbs:
            answer = await self.send(verb)
            assert isinstance(answer, Applied), answer


@pytest.fixture
def arm(tmp_path):
    return Arm(tmp_path)


async def test_ready_is_sent_once_whatever_a_client_does_while_the_estimator_is_built(arm):
    arm.loop.estimates.process.state = WorkerState(running=False, restarts=0, gave_up=False)
    arm.step(3)
    assert (arm.loop.mode, arm.ready) == (Mode.STARTING, [])
    await arm.demand("stop", "clear")
    arm.step()
    assert (arm.loop.mode, arm.ready) == (Mode.STARTING, [])
    await arm.demand("stop")
    arm.loop.estimates.process.state = WorkerState(running=True, restarts=0, gave_up=False)
    arm.step(3)
    assert arm.ready == [Mode.FAULTED]
    await arm.demand("clear")
    assert arm.loop.mode is Mode.IDLE


async def test_a_service_whose_estimator_cannot_be_built_does_not_call_it_ready(arm):
    arm.loop.estimates.process.state = WorkerState(running=False, restarts=2, gave_up=False)
    arm.step()
    assert arm.loop.mode is Mode.STARTING
    arm.loop.estimates.process.state = WorkerState(running=False, restarts=6, gave_up=True)
    arm.step()
    assert arm.loop.mode is Mode.IDLE
    (change,) = [event.text for event in arm.sink.of("event") if event.kind == "mode"]
    assert "cannot be built" in change


async def test_every_change_of_mode_is_an_event_and_in_the_journal_with_who_asked(arm, caplog):
    caplog.set_level(logging.INFO, "softarm")
    arm.step()
    await arm.demand("lease/acquire", "arm", "teach/start", "teach/hold", "teach/release", "disarm")
    await arm.send("stop", client="bob")
    await arm.demand("clear")
    changes = [(event.text.split(":")[0], event.by) for event in arm.sink.of("event") if event.kind == "mode"]
    assert changes == [
        ("STARTING -> IDLE", "service"),
        ("IDLE -> ARMED", "ann"),
        ("ARMED -> TEACH", "ann"),
        ("TEACH -> HOLDING", "ann"),
        ("HOLDING -> ARMED", "ann"),
        ("ARMED -> IDLE", "ann"),
        ("IDLE -> FAULTED", "bob"),
        ("FAULTED -> IDLE", "ann"),
    ]
    for change, by in changes:
        assert any(change in line and by in line for line in caplog.messages), change


async def test_a_search_that_diverged_counts_as_failed_and_leaves_the_last_pose(arm):
    arm.step(10)
    await arm.demand("lease/acquire", "arm", "teach/start")
    nowhere = {"positions": np.full((3, 3), np.nan), "degrees_of_freedom": np.nan}
    published = len(arm.sink.of("estimate"))
    arm.loop.estimates.on_result(replace(arm.loop.estimator_state.result, **nowhere))
    state = arm.loop.estimator_state
    assert (state.failures, state.hold, state.held) == (1, None, None)
    assert state.tare_now() is None
    assert len(arm.sink.of("estimate")) == published
    assert np.isfinite([section.position_m for section in state.sections]).all()
    arm.step()
    assert (state.failures, arm.loop.mode) == (0, Mode.TEACH)


async def test_a_command_that_waits_for_an_estimate_ends_with_its_mode(arm):
    arm.step()
    await arm.demand("lease/acquire", "arm", "teach/start")
    state = arm.loop.estimator_state
    state.update(replace(state.result, hold=None), UNIX_NS)
    asked = asyncio.create_task(arm.send("teach/hold", deadline_unix_ns=UNIX_NS + 10**9))
    await asyncio.sleep(0)
    await arm.send("stop", client="bob")
    answer = await asyncio.wait_for(asked, 0.2)  # the caller would wait for a second
    assert answer.code == "wrong_mode"
    assert "changed to FAULTED" in answer.message


async def test_a_report_that_fails_does_not_keep_the_arm_from_being_vented(arm, monkeypatch):
    arm.step()
    await arm.demand("lease/acquire", "arm")
    monkeypatch.setattr(arm.sink, "publish", lambda *_: 1 / 0)
    await arm.demand("stop")
    assert arm.loop.mode is Mode.FAULTED
    assert not arm.instruments.valves.armed


async def test_a_fault_publishes_no_more_states_than_any_other_mode(arm):
    arm.step()
    await arm.demand("stop")
    before = len(arm.sink.of("state"))
    arm.step(100)
    assert len(arm.sink.of("state")) - before == 20


async def test_a_complete_packet_starts_an_estimate_without_waiting_for_a_tick(arm):
    arm.step()
    before = len(arm.loop.estimates.process.requests)
    arm.now_ns += TICK_NS
    arm.instruments.read()
    assert len(arm.loop.estimates.process.requests) == before + 1


@pytest.mark.parametrize(("age_ticks", "requested"), [(0.3, True), (0.4, False), (1.4, False), (1.6, True)])
async def test_a_process_that_becomes_free_waits_for_a_packet_that_is_due(
    arm, monkeypatch, age_ticks, requested
):
    arm.step(2)
    waiting = []
    monkeypatch.setattr(arm.loop.estimates.process, "submit", waiting.append)
    arm.now_ns += TICK_NS
    arm.instruments.read()
    arm.now_ns += round(age_ticks * TICK_NS)
    assert (waiting[-1]() is not None) is requested


async def test_a_tick_that_waits_for_a_packet_does_not_keep_that_from_starting_an_estimate(arm):
    arm.step(2)
    estimates = arm.loop.estimates
    estimates._requested_ns -= 2 * TICK_NS  # the process was busy for so long
    before = len(estimates.process.requests)
    arm.now_ns += round(0.6 * TICK_NS)
    estimates.on_tick(arm.now_ns)
    assert len(estimates.process.requests) == before
    arm.now_ns += round(0.3 * TICK_NS)
    arm.instruments.read()
    assert len(estimates.process.requests) == before + 1


async def test_nothing_waits_for_packets_that_come_more_slowly_than_ticks(arm, monkeypatch):
    waiting = []
    monkeypatch.setattr(arm.loop.estimates.process, "submit", waiting.append)
    for _ in range(2):
        arm.now_ns += 3 * TICK_NS
        arm.instruments.read()
    arm.now_ns += 2 * TICK_NS
    assert waiting[-1]() is not None


@pytest.mark.parametrize(
    ("verbs", "mode"),
    [
        (("arm",), Mode.ARMED),
        (("arm", "teach/start"), Mode.FAULTED),
        (("arm", "teach/start", "teach/hold"), Mode.FAULTED),
    ],
)
async def test_a_set_point_that_ran_out_ends_teaching_and_holding(arm, verbs, mode):
    arm.step()
    await arm.demand("lease/acquire", verbs[0])
    await arm.send("set_pressures", pressures_pa=[1e4] * 6, lifetime_s=5.0)
    await arm.demand(*verbs[1:])
    arm.step(2)
    arm.instruments.expiries += 1
    arm.step(2)
    assert arm.loop.mode is mode
    if mode is Mode.FAULTED:
        assert "expired" in arm.loop.controller.modes.fault_cause
        assert not arm.instruments.valves.armed


async def test_a_force_that_is_not_estimated_is_not_said_to_be_known(arm):
    arm.step()
    estimate = arm.sink.of("estimate")[-1]
    for load in estimate.loads:
        covariance = np.array(load.covariance_n2, dtype=float)
        assert np.isfinite(covariance[:2, :2]).all()
        assert np.isnan(covariance[2]).all()
        assert np.isnan(covariance[:, 2]).all()
        assert f"force on {load.section} along z: it is not estimated" in estimate.unobservable
    json.loads(estimate.model_dump_json(), parse_constant=lambda word: pytest.fail(word))


async def test_the_latency_of_an_estimate_ends_at_its_stamp(tmp_path):
    """What a subscriber adds from the stamp on must not be in it already."""
    ticking = itertools.count(10**9, 1000)
    arm = Arm(tmp_path, Clocks(lambda: next(ticking), lambda: UNIX_NS))
    arm.step(3)
    request, estimate = arm.loop.estimates.process.requests[-1], arm.sink.of("estimate")[-1]
    ended_ns = request.newest_arrival_ns + estimate.latency_s * 1e9
    assert ended_ns == pytest.approx(estimate.stamp.monotonic_ns, abs=0.1)


async def test_advice_names_the_recording_and_the_specimen(arm):
    arm.step(2)
    advice = arm.loop._reporter._publisher._advice
    assert "record/start" in advice(None)
    assert advice("run.mcap").endswith("softarm diagnose run.mcap --specimen sopra")


async def test_a_slow_disk_keeps_neither_the_loop_nor_another_command_waiting(tmp_path, monkeypatch):
    arm = Arm(tmp_path, Clocks())
    free, begun, save = threading.Event(), threading.Event(), PoseStore.save

    def slow(store, name, pose):
        begun.set()
        assert free.wait(30.0)
        save(store, name, pose)

    monkeypatch.setattr(PoseStore, "save", slow)
    deadline = {"deadline_unix_ns": time.time_ns() + 30 * 10**9}
    with Ticker(TICK_NS * 1e-9) as ticker:
        saving, ticks, begun_s, latest_s = None, 0, 0.0, 0.0
        async for tick in ticker.ticks():
            arm.instruments.read()
            arm.loop.step(tick)
            if saving is None:
                begun_s = time.monotonic()
                saving = asyncio.create_task(arm.send("teach/save", name="a", **deadline))
            elif begun.is_set():
                ticks += 1
                latest_s = max(latest_s, tick.late_ns * 1e-9)
                assert isinstance(await arm.send("teach/list", **deadline), Applied)
            if ticks == 100:
                break
        assert not saving.done()
        blocked_s = time.monotonic() - begun_s
        free.set()
        assert (await saving).applied["name"] == "a"
    state = arm.sink.of("state")[-1]
    assert 0.0 <= state.drift_median_s <= state.drift_p99_s
    # A loop that waits for the disk is late by all of the second and more for which this disk blocks.
    assert latest_s < 0.25 * blocked_s, (latest_s, blocked_s)


async def test_a_pose_that_the_disk_does_not_take_is_refused_in_time(arm, monkeypatch):
    free = threading.Event()
    monkeypatch.setattr(command_handler, "SAVE_S", 0.05)
    monkeypatch.setattr(PoseStore, "save", lambda *_: free.wait(30.0))
    arm.step()
    await arm.demand("lease/acquire", "arm", "teach/start")
    answer = await asyncio.wait_for(arm.send("teach/save", name="a"), 20.0)
    free.set()
    assert (answer.code, answer.message) == ("not_available", "the disk did not answer within 0.05 s")


async def test_drift_of_the_ticks_is_published(arm):
    arm.step(50)
    arm.step(50, drift_ns=4_000_000)
    state = arm.sink.of("state")[-1]
    assert state.drift_p99_s == pytest.approx(4e-3)


async def test_ticks_that_were_skipped_count_as_late(arm):
    arm.step(50)
    schedule = TickSchedule(arm.now_ns + TICK_NS, TICK_NS)
    arm.now_ns += 10 * TICK_NS
    arm.loop.step(schedule.begin_tick(arm.now_ns))
    arm.step(9)
    assert arm.sink.of("state")[-1].drift_p99_s > 0.03


async def test_an_estimator_that_has_just_become_ready_is_given_its_deadline(arm):
    estimates = arm.loop.estimates
    estimates.process.state = WorkerState(running=False, restarts=0, gave_up=False)
    assert estimates.observe(arm.now_ns).age_s is None
    estimates.process.state = WorkerState(running=True, restarts=0, gave_up=False, was_ready=True)
    arm.now_ns += 60 * 10**9
    assert estimates.observe(arm.now_ns).age_s == 0.0
    arm.now_ns += 10**9
    assert estimates.observe(arm.now_ns).age_s == 1.0


def test_waiting_for_a_processor_is_read_for_the_own_unit_where_that_of_the_host_is_hidden(tmp_path):
    groups, own = tmp_path / "cgroup", tmp_path / "cpu.pressure"
    groups.write_text("4:memory:/other\n0::/system.slice/softarm@left.service\n")
    unit = pressure_files(groups)[-1]
    assert str(unit) == "/sys/fs/cgroup/system.slice/softarm@left.service/cpu.pressure"
    own.write_text("some avg10=12.50 avg60=1.00 avg300=0.10 total=5\nfull avg10=0.00 avg60=0.00\n")
    assert read_pressure([tmp_path / "hidden", own]) == 12.5
    assert read_pressure([tmp_path / "hidden"]) is None


@pytest.mark.parametrize("starved_percent", [0.0, 90.0])
async def test_a_fault_of_a_busy_machine_names_the_processor(tmp_path, starved_percent):
    arm = Arm(tmp_path, host=lambda: HostLoad(None, starved_percent))
    arm.step()
    await arm.demand("lease/acquire", "arm")
    await arm.send("set_pressures", pressures_pa=[1e4] * 6, lifetime_s=5.0)
    await arm.demand("teach/start")
    arm.step(2)
    arm.instruments.expiries += 1
    arm.step()
    cause = arm.loop.controller.modes.fault_cause
    assert "expired" in cause
    assert ("programs waited for the processor 90 %" in cause) is (starved_percent > 0.0)


async def test_silence_while_the_loop_was_late_is_laid_to_the_processor(arm):
    arm.step(600)
    schedule = TickSchedule(arm.now_ns + TICK_NS, TICK_NS)
    arm.now_ns += 300_000_000
    arm.loop.step(schedule.begin_tick(arm.now_ns))
    stale = [f for f in arm.sink.of("state")[-1].findings if f.code == "stale_sensor"]
    assert stale
    assert all("came 290 ms late" in f.message and "processor" in f.hint for f in stale)


def test_a_disk_that_hangs_does_not_hang_the_look_at_it(tmp_path):
    free = threading.Event()

    def hanging(path):
        free.wait(30.0)
        return 5

    with HostWatch(tmp_path, hanging) as watch:
        assert watch.newest == HostLoad()
        free.set()


async def test_a_device_that_is_unplugged_is_found_and_can_be_reconnected(arm):
    arm.instruments.status = (
        DeviceStatus("gauge", connected=False, error="cannot be reached", cure="plug it in"),
    )
    arm.step(10)
    (finding,) = [f for f in arm.sink.of("state")[-1].findings if f.where == "gauge"]
    assert (finding.code, finding.severity) == ("device_lost", "warning")
    refused = await arm.send("device/reconnect", device="nobody")
    assert (refused.code, "nobody" in refused.message) == ("malformed", True)
    await arm.demand("lease/acquire", "arm")
    refused = await arm.send("device/reconnect", device="gauge")
    assert (refused.code, refused.hint) == ("wrong_mode", "disarm first")


@pytest.mark.parametrize(
    ("verb", "fields", "word"),
    [
        (
            "set_pressures",
            {"pressures_pa": [0.0] * 6, "lifetime_s": 1.0},
            "clear the fault with clear, then arm",
        ),
        ("teach/start", {}, "clear the fault with clear, then arm"),
        ("arm", {}, "clear the fault with clear, then arm"),
    ],
)
async def test_hints_in_faulted_name_the_way_out(arm, verb, fields, word):
    arm.step()
    await arm.demand("lease/acquire", "stop")
    assert (await arm.send(verb, **fields)).hint == "clear the fault with clear, then arm"


async def test_a_folder_that_cannot_be_written_is_named_without_a_number(arm, tmp_path):
    arm.step()
    (tmp_path / "recordings").write_text("a file where a folder should be")
    await arm.demand("lease/acquire")
    refused = await arm.send("record/start", name="run")
    assert "recordings" in refused.message
    assert "Errno" not in refused.message


async def test_a_bank_that_vents_by_itself_ends_the_mode_and_is_named(arm):
    arm.step()
    await arm.demand("lease/acquire", "arm")
    arm.step()
    assert arm.loop.mode is Mode.ARMED
    arm.instruments.valves.armed = False
    arm.step()
    assert arm.loop.mode is Mode.FAULTED
    assert "the valve bank has vented by itself" in arm.sink.of("event")[-1].text


async def test_stored_readings_raise_no_live_alarm(arm):
    arm.instruments.source = "replay"
    arm.instruments.status = (DeviceStatus("gauge", connected=False, error="cannot be reached"),)
    arm.step(10)
    assert arm.sink.of("state")[-1].findings == ()


def test_a_disk_that_does_not_answer_leaves_its_free_space_unknown(tmp_path):
    def hangs_and_fails(path):
        raise OSError(f"{path} is not answering")

    watch = HostWatch(tmp_path / "not" / "made", hangs_and_fails)
    watch.check()
    assert watch.newest.free_bytes is None
    asked = []
    watch = HostWatch(tmp_path / "not" / "made", lambda path: asked.append(path) or 7)
    watch.check()
    assert (watch.newest.free_bytes, asked) == (7, [tmp_path])
