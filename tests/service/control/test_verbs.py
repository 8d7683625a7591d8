import asyncio
import json
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acceptance.reference.api_examples import EXAMPLES
from softarm.daemon.config import ControlSettings, SafetySettings
from softarm.daemon.control.command_handler import ANSWER_S, CommandContext, CommandHandler
from softarm.daemon.control.controller import Controller
from softarm.daemon.control.estimator_state import RECENT_S, EstimatorState
from softarm.daemon.control.poses import PoseStore
from softarm.daemon.control.recorder import Recorder
from softarm.daemon.estimation.messages import EstimationRequest, EstimationResult, HoldAnswer
from softarm.daemon.safety.diagnostics import Diagnostic
from softarm.daemon.safety.modes import PRESSURISED, Mode, Trigger
from softarm.drivers.errors import ConnectionLost, DeviceErrors, InterlockError, LimitError
from softarm.estimator.model import Load
from softarm.recordings.info import parse_info
from softarm.recordings.mcap_reader import read_contents
from softarm_client.commands import VERBS, Applied, Refused

LIMIT = 65e3
LOADS = tuple(
    Load(f"{section}_{axis}", "force", direction, section=section)
    for section in ("intermediate", "tip")
    for axis, direction in {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}.items()
)
SECOND = 1_000_000_000


class Valves:
    """Valves as the controller sees them, remembering what they were told."""

    def __init__(self):
        self.armed, self.pressures, self.vents = False, (0.0,) * 6, 0

    def arm(self):
        self.armed = True

    def vent(self, reason):
        self.armed, self.pressures = False, (0.0,) * 6
        self.vents += 1

    def acknowledge(self):
        return False

    def command(self, setpoint, lifetime_s):
        assert self.armed
        if not all(0.0 <= p <= LIMIT for p in setpoint):
            raise LimitError(
                "valves", "set-point out of range", "ask for less", value=max(setpoint), limit=LIMIT
            )
        self.pressures = tuple(setpoint)


def hold_answer(pressure=20e3):
    return HoldAnswer(np.full(6, pressure), reachable=True, note="")


def result(hold=None, loads=(0.0, 0.0, 0.0, 0.0), time_s=0.0):
    return EstimationResult(
        request=EstimationRequest(time_s, 0, np.zeros(0), np.zeros(6), np.zeros(3)),
        converged=True,
        model="fem",
        loads=np.array(loads),
        load_covariance=1e-4 * np.eye(4),
        positions=np.zeros((3, 3)),
        quaternions=np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)),
        frame_std=np.zeros((3, 6)),
        innovation_squared=1.0,
        degrees_of_freedom=1.0,
        hold=hold,
    )


def failed(time_s):
    """A search for the hold that did not converge."""
    unknown = HoldAnswer(np.zeros(6), reachable=False, note="nothing is known", valid=False)
    return replace(result(unknown, time_s=time_s), converged=False)


class Bench:
    """The control side of a service without devices, network or clock."""

    def __init__(self, tmp_path):
        self.now_ns = 0
        self.unix_ns = 10**18
        self.valves = Valves()
        self.controller = Controller(
            self.valves, np.full(6, LIMIT), ControlSettings(), SafetySettings(lease_s=1.0)
        )
        sections = ("base", "intermediate", "tip")
        self.estimator_state = EstimatorState(sections, LOADS, self.align, lambda: self.now_ns)
        self.estimator_state.update(result(hold_answer()), 0)
        self.faults = ()
        context = CommandContext(
            self.controller,
            self.estimator_state,
            Recorder(tmp_path / "recordings"),
            PoseStore(tmp_path / "poses.json"),
            {},
            self.reconnect,
            lambda _: self.faults,
            lambda: self.now_ns,
            lambda: self.unix_ns,
        )
        self.verbs = CommandHandler(context)
        self.sequence = 0
        self.reconnected = []
        self.token = ""
        self.controller.fire(Trigger.READY, "test")

    async def send(self, verb, **fields):
        self.sequence += 1
        request = {
            "deadline_unix_ns": self.unix_ns + SECOND,
            "sequence": self.sequence,
            "client": "test",
        }
        if "lease" in VERBS[verb].model_fields and self.token:
            request["lease"] = self.token
        return await self.verbs.answer(verb, json.dumps(request | fields).encode())

    async def reconnect(self, name):
        self.reconnected.append(name)
        if name == "unknown":
            raise KeyError(name)

    def align(self, rotations, now_ns):
        self.aligned = (rotations["tip"].tolist(), now_ns)
        return ("imu",)

    async def acquire(self):
        self.token = (await self.send("lease/acquire")).applied["lease"]

    async def armed(self):
        await self.acquire()
        await self.send("arm")
        return self

    def tick(self, seconds=0.01):
        self.now_ns += round(seconds * 1e9)
        return self.controller.tick(self.now_ns, seconds, self.estimator_state.hold)

    @property
    def mode(self):
        return self.controller.modes.mode


@pytest.fixture
def bench(tmp_path):
    return Bench(tmp_path)


def code(answer):
    return answer.code if isinstance(answer, Refused) else None


async def test_every_verb_is_served(bench):
    for verb in VERBS:
        assert code(await bench.send(verb, lease="x")) != "internal"


async def test_moving_needs_the_lease_and_stop_does_not(bench):
    assert code(await bench.send("arm", lease="guess")) == "no_lease"
    await bench.armed()
    assert bench.mode is Mode.ARMED
    bench.token = ""
    assert isinstance(await bench.send("stop"), Applied)
    assert bench.mode is Mode.FAULTED
    assert not bench.valves.armed


async def test_set_point_is_applied_expires_and_vents(bench):
    await bench.armed()
    answer = await bench.send("set_pressures", pressures_pa=[1e4] * 6, lifetime_s=0.5)
    assert answer.applied["asked_pa"] == [1e4] * 6
    bench.tick(0.4)
    assert bench.valves.pressures == (1e4,) * 6
    bench.tick(0.2)
    np.testing.assert_array_equal(bench.controller.setpoint, np.zeros(6))


async def test_out_of_limit_is_refused_and_nothing_moves(bench):
    await bench.armed()
    await bench.send("set_pressures", pressures_pa=[1e4] * 6, lifetime_s=5)
    answer = await bench.send("set_pressures", pressures_pa=[7e4] + [0.0] * 5, lifetime_s=5)
    assert code(answer) == "out_of_limit"
    bench.tick()
    assert bench.valves.pressures == (1e4,) * 6


async def test_lost_lease_vents(bench):
    await bench.armed()
    await bench.send("set_pressures", pressures_pa=[1e4] * 6, lifetime_s=5)
    transition = bench.tick(1.1)
    assert transition.trigger is Trigger.LEASE_LOST
    assert bench.mode is Mode.IDLE
    assert bench.valves.pressures == (0.0,) * 6


async def test_stop_is_never_too_late(bench):
    await bench.armed()
    assert isinstance(await bench.send("stop", deadline_unix_ns=1), Applied)
    assert bench.mode is Mode.FAULTED


async def test_command_without_a_lease_is_told_how_to_get_one(bench):
    answer = await bench.verbs.answer("arm", b'{"deadline_unix_ns": 1, "sequence": 1, "client": "x"}')
    assert (code(answer), "lease/acquire" in answer.hint) == ("no_lease", True)


async def test_everything_that_a_request_lacks_is_named_at_once(bench):
    answer = await bench.verbs.answer("set_pressures", b'{"client": "x", "lifetime_s": 50}')
    assert code(answer) == "malformed"
    for name in ("deadline_unix_ns", "sequence", "lease", "pressures_pa", "lifetime_s"):
        assert f"{name}: " in answer.message


async def test_late_repeated_and_malformed_commands_are_refused(bench):
    await bench.armed()
    late = await bench.send("disarm", deadline_unix_ns=bench.unix_ns - 1)
    again = await bench.send("disarm", sequence=1)
    odd = await bench.verbs.answer("disarm", b"{")
    unknown = await bench.verbs.answer("dance", b"{}")
    assert [code(answer) for answer in (late, again, odd, unknown)] == [
        "stale",
        "stale",
        "malformed",
        "malformed",
    ]
    assert bench.mode is Mode.ARMED


async def test_fault_that_stands_keeps_from_arming_and_clearing(bench):
    bench.faults = (Diagnostic("valves_lost", "valves", "fault", "gone", "look"),)
    await bench.acquire()
    assert code(await bench.send("arm")) == "not_available"
    await bench.send("stop")
    assert code(await bench.send("clear")) == "not_available"
    bench.faults = ()
    assert (await bench.send("clear")).applied == {"cleared": "stopped by test", "acknowledged": False}
    assert bench.mode is Mode.IDLE


async def test_teach_hold_ramps_without_a_bump_then_saves_and_returns(bench):
    await bench.armed()
    await bench.send("teach/start")
    await bench.send("teach/hold", ramp_s=1.0)
    seen = []
    for _ in range(150):
        bench.tick()
        await bench.send("lease/acquire", lease=bench.token)
        seen.append(bench.valves.pressures[0])
    assert max(np.abs(np.diff([0.0, *seen]))) < 1.6 * 20e3 * 0.01
    assert seen[-1] == pytest.approx(20e3, rel=1e-3)
    bench.estimator_state.update(result(hold_answer(), time_s=bench.now_ns * 1e-9), 0)
    await bench.send("teach/save", name="a")
    await bench.send("teach/release")
    assert bench.mode is Mode.ARMED
    bench.tick()
    assert bench.valves.pressures[0] == pytest.approx(20e3, rel=1e-3)
    assert set((await bench.send("teach/list")).applied) == {"a"}
    assert (await bench.send("teach/goto", name="a")).mode == Mode.HOLDING
    assert code(await bench.send("teach/goto", name="b")) == "not_available"


@pytest.mark.parametrize(("later_s", "mode"), [(0.1, Mode.HOLDING), (RECENT_S + 0.1, Mode.TEACH)])
async def test_one_search_that_fails_does_not_keep_a_pose_from_being_held(bench, later_s, mode):
    await bench.armed()
    await bench.send("teach/start")
    bench.now_ns = round(later_s * SECOND)
    bench.estimator_state.update(failed(later_s), 0)
    answer = await bench.send("teach/hold")
    assert bench.mode is mode
    if mode is Mode.HOLDING:
        assert bench.controller.hold.goal.pressures[0] == 20e3
    else:
        assert code(answer) == "not_available"


@pytest.mark.parametrize(
    ("verb", "fields"), [("teach/hold", {}), ("teach/save", {"name": "a"}), ("estimate/tare", {})]
)
async def test_an_estimate_of_where_the_arm_was_earlier_is_not_acted_on(bench, verb, fields):
    """An estimator that has stopped is a fault after a second only: meanwhile a hand moves the arm on."""
    await bench.armed()
    await bench.send("teach/start")
    bench.now_ns = round((RECENT_S + 0.1) * SECOND)
    soon = bench.unix_ns + round(1.1 * ANSWER_S * SECOND)
    refused = await bench.send(verb, deadline_unix_ns=soon, **fields)
    assert code(refused) == "not_available"
    assert "last 0.5 s" in refused.message or verb == "estimate/tare"
    assert bench.mode is Mode.TEACH
    asked = asyncio.create_task(bench.send(verb, **fields))
    bench.estimator_state.update(result(hold_answer(10e3), time_s=bench.now_ns * 1e-9), 0)
    answer = await asked
    assert isinstance(answer, Applied), answer


async def test_feedback_on_a_pose_pauses_while_no_estimate_comes(bench):
    await bench.armed()
    await bench.send("teach/start")
    await bench.send("teach/hold", ramp_s=0.1)
    off = replace(hold_answer(), towards=np.full(6, 5e3))
    bench.estimator_state.update(result(off), 0)
    corrections = []
    for _ in range(90):
        bench.tick()
        corrections.append(bench.controller.hold.correction[0])
    stopped = round(RECENT_S / 0.01)
    assert np.all(np.diff(corrections[: stopped - 1])[10:] > 0.0)
    assert np.all(np.diff(corrections[stopped:]) == 0.0)


async def test_a_saved_pose_is_the_one_that_its_pressures_hold(bench):
    await bench.armed()
    await bench.send("teach/start")
    elsewhere = replace(failed(0.1), positions=np.ones((3, 3)))
    bench.estimator_state.update(elsewhere, 0)
    await bench.send("teach/save", name="a")
    sections = (await bench.send("teach/list")).applied["a"].sections
    assert {section.position_m for section in sections} == {(0.0, 0.0, 0.0)}


async def test_set_points_are_refused_while_holding(bench):
    await bench.armed()
    await bench.send("teach/hold")
    answer = await bench.send("set_pressures", pressures_pa=[0.0] * 6, lifetime_s=1)
    assert code(answer) == "wrong_mode"


async def test_recording_starts_and_stops(bench):
    path = (await bench.send("record/start", name="run")).applied["path"]
    assert code(await bench.send("record/start")) == "not_available"
    assert (await bench.send("record/stop")).applied == {"path": path, "dropped": 0}
    kept = read_contents(Path(path)).attachments
    assert parse_info("run", kept["recording.toml"])["session_start_s"] >= 0.0


@settings(max_examples=60, deadline=None)
@given(verbs=st.lists(st.sampled_from([*VERBS, "tick", "late tick"]), max_size=25))
async def test_pressure_only_in_pressurised_modes(tmp_path_factory, verbs):
    bench = Bench(tmp_path_factory.mktemp("bench"))
    await bench.acquire()
    for verb in verbs:
        if verb.endswith("tick"):
            bench.tick(1.5 if verb == "late tick" else 0.01)
        else:
            fields = {
                "set_pressures": {"pressures_pa": [1e4] * 6, "lifetime_s": 1.0},
                "teach/goto": {"name": "a"},
                "teach/save": {"name": "a"},
            }.get(verb, {})
            answer = await bench.send(verb, **fields)
            if verb == "lease/acquire" and isinstance(answer, Applied):
                bench.token = answer.applied["lease"]
        if bench.mode not in PRESSURISED:
            assert not bench.valves.armed
            assert bench.valves.pressures == (0.0,) * 6
    bench.controller.fire(Trigger.FAULT, "test")
    assert not bench.valves.armed


DISTURBING = {
    "clear": {},
    "estimate/tare": {},
    "calibrate/rest": {},
    "teach/save": {"name": "a"},
}


async def test_another_client_does_not_disturb_the_holder_of_the_lease(bench):
    await bench.acquire()
    mine = bench.token
    path = (await bench.send("record/start", name="mine")).applied["path"]
    bench.token = ""
    for verb, fields in {**DISTURBING, "record/stop": {}}.items():
        assert code(await bench.send(verb, client="bob", **fields)) == "lease_held", verb
    bench.token = mine
    assert (await bench.send("record/stop")).applied["path"] == path
    for verb, fields in DISTURBING.items():
        assert code(await bench.send(verb, **fields)) != "lease_held", verb


async def test_what_disturbs_nobody_is_free_to_all(bench):
    for verb, fields in DISTURBING.items():
        assert code(await bench.send(verb, **fields)) not in ("lease_held", "no_lease"), verb


async def test_recording_that_was_begun_without_the_lease_is_ended_without_it(bench):
    await bench.send("record/start", name="free")
    await bench.acquire()
    bench.token = ""
    assert code(await bench.send("record/stop", client="bob")) is None


async def test_free_verbs_take_a_lease_and_do_not_need_it(bench):
    for verb in ("teach/list", "record/start", "record/stop", "lease/acquire"):
        assert code(await bench.send(verb, lease="of yesterday")) is None, verb


async def test_name_of_a_client_is_plain(bench):
    for name in ("<b>x</b>", "x" * 41, "", "two\nlines"):
        assert code(await bench.send("teach/list", client=name)) == "malformed"


@pytest.mark.parametrize(
    ("sent_s", "deadline_s", "words"),
    [
        (3.2, 4.2, "3.2 s ahead of the service's"),
        (-2.5, -1.5, "sent 2.5 s ago, or the clock of its host is that far behind"),
        (None, -0.5, "the deadline passed 0.500 s ago"),
        (None, 90.0, "the deadline is 90.0 s ahead, more than 60 s"),
    ],
)
async def test_clocks_that_differ_are_named_in_seconds(bench, sent_s, deadline_s, words):
    sent = None if sent_s is None else bench.unix_ns + round(sent_s * SECOND)
    deadline = bench.unix_ns + round(deadline_s * SECOND)
    answer = await bench.send("teach/list", sent_unix_ns=sent, deadline_unix_ns=deadline)
    assert code(answer) == "stale"
    assert words in answer.message
    assert "NTP" in answer.hint


async def test_clocks_within_a_second_are_good_enough(bench):
    for sent_s in (-0.9, 0.9):
        sent = bench.unix_ns + round(sent_s * SECOND)
        assert code(await bench.send("teach/list", sent_unix_ns=sent)) is None


async def test_answers_hold_what_the_api_page_shows(bench):
    await bench.acquire()
    order = (
        *("arm", "set_pressures", "teach/start", "teach/hold", "teach/save", "teach/goto", "teach/release"),
        *("experiment/begin", "experiment/end", "estimate/tare", "record/start", "record/stop", "disarm"),
        *("calibrate/rest", "stop", "clear", "lease/release", "lease/acquire"),
    )
    for verb in order:
        answer = await bench.send(verb, **EXAMPLES[verb].fields)
        assert isinstance(answer, Applied), (verb, answer)
        assert set(answer.applied) == set(EXAMPLES[verb].applied), verb


class Lax(Valves):
    """A valve bank that is set up for more than the specimen bears."""

    def command(self, setpoint, lifetime_s):
        assert self.armed
        self.pressures = tuple(setpoint)


@pytest.mark.parametrize("pressure", [LIMIT + 1.0, -1.0, float("nan"), float("inf")])
async def test_no_set_point_above_the_specimen_reaches_a_valve(bench, pressure):
    bench.controller._valves = bench.valves = Lax()
    await bench.armed()
    with pytest.raises(LimitError):
        bench.controller.request_setpoint(np.full(6, pressure), 1.0, bench.now_ns)
    with pytest.raises(LimitError):
        bench.controller.request_setpoint(np.zeros(5), 1.0, bench.now_ns)
    assert bench.valves.pressures == (0.0,) * 6


async def test_hold_that_asks_for_what_no_chamber_bears_is_a_fault(bench):
    bench.controller._valves = bench.valves = Lax()
    await bench.armed()
    await bench.send("teach/hold", ramp_s=0.1)
    bench.controller._limits = np.full(6, 10e3)  # as if the hold ran on other limits: it goes to 20 kPa
    transitions = [bench.tick(0.02) for _ in range(10)]
    assert max(bench.valves.pressures) <= 10e3
    assert bench.mode is Mode.FAULTED
    assert "out of range" in next(t for t in transitions if t is not None).cause


@pytest.mark.parametrize(("verb", "fields"), [("teach/hold", {}), ("teach/save", {"name": "a"})])
async def test_pose_that_is_not_estimated_yet_is_waited_for_as_long_as_the_caller_does(bench, verb, fields):
    await bench.armed()
    await bench.send("teach/start")
    bench.estimator_state.update(result(None), 0)
    asked = asyncio.create_task(bench.send(verb, **fields))
    await asyncio.sleep(0)
    bench.estimator_state.update(result(None), 0)  # was begun before the mode asked for pressures
    await asyncio.sleep(0)
    assert not asked.done()
    bench.estimator_state.update(result(hold_answer()), 0)
    answer = await asked
    assert isinstance(answer, Applied), answer
    assert answer.applied["pressures_pa"] == [20e3] * 6


async def test_pose_that_is_not_estimated_in_time_is_refused_before_the_caller_has_left(bench):
    await bench.armed()
    await bench.send("teach/start")
    bench.estimator_state.update(result(None), 0)
    answer = await bench.send("teach/hold", deadline_unix_ns=bench.unix_ns + round(0.9 * ANSWER_S * SECOND))
    assert (code(answer), bench.mode) == ("not_available", Mode.TEACH)


async def test_command_that_waits_for_an_estimate_does_not_outlive_a_stop(bench):
    await bench.armed()
    await bench.send("teach/start")
    bench.estimator_state.update(result(None), 0)
    asked = asyncio.create_task(bench.send("teach/hold"))
    await asyncio.sleep(0)
    for verb in ("stop", "clear", "arm", "teach/start"):
        assert isinstance(await bench.send(verb), Applied)
    bench.estimator_state.update(result(hold_answer()), 0)
    assert code(await asked) == "wrong_mode"
    assert bench.mode is Mode.TEACH


@pytest.mark.parametrize(("verb", "word"), [("stop", "stopped by test"), ("disarm", "IDLE")])
async def test_pose_that_no_mode_estimates_is_refused_with_the_cause(bench, verb, word):
    await bench.armed()
    await bench.send("teach/start")
    await bench.send(verb)
    bench.estimator_state.update(result(None), 0)
    answer = await bench.send("teach/save", name="a")
    assert code(answer) == "wrong_mode"
    assert word in answer.message


async def test_a_refusal_names_what_failed_and_what_to_do(bench, monkeypatch):
    """Whatever fails in a command ends that command alone."""

    def failing(error):
        def arm():
            raise error

        return arm

    await bench.acquire()
    for error, code, words, hint in (
        (
            InterlockError("valves", "the interlock is open", "close it"),
            "not_available",
            "interlock",
            "close",
        ),
        (OSError(28, "No space left on device", "/rec"), "not_available", "/rec: No space left", "has room"),
        (ZeroDivisionError(), "internal", "the command failed", "log"),
    ):
        monkeypatch.setattr(bench.valves, "arm", failing(error))
        refused = await bench.send("arm")
        assert refused.code == code
        assert words in refused.message
        assert hint in refused.hint
    monkeypatch.undo()
    assert isinstance(await bench.send("arm"), Applied)


async def test_no_force_is_tared_without_an_estimate_that_converged(bench):
    bench.estimator_state.update(failed(0.0), 0)
    refused = await bench.send("estimate/tare")
    assert (refused.code, refused.message) == ("not_available", "no estimate to tare")
    bench.estimator_state.update(result(loads=(0.1, 0.0, 0.0, 0.2)), 0)
    assert (await bench.send("estimate/tare")).applied == {"loads_n": [0.1, 0.0, 0.0, 0.2]}


async def test_a_device_that_does_not_come_back_is_refused_with_its_cure(bench, monkeypatch):
    async def unplugged(name):
        raise DeviceErrors("the gauge", [ConnectionLost(name, "cannot be reached", "plug it in")])

    bench.verbs = CommandHandler(replace(bench.verbs._context, reconnect=unplugged))
    refused = await bench.send("device/reconnect", device="gauge")
    assert (refused.code, refused.message) == ("not_available", "gauge: cannot be reached")
    assert refused.hint == "plug it in"


async def test_one_recording_is_opened_at_a_time(bench):
    bench.verbs._context.recorder.start = lambda *_: opened.wait(5.0) and Path("run.mcap")
    opened = threading.Event()
    first, second = (asyncio.ensure_future(bench.send("record/start", name=n)) for n in ("one", "two"))
    done, _ = await asyncio.wait((first, second), return_when=asyncio.FIRST_COMPLETED)
    assert done == {second}
    assert second.result().code == "busy"
    opened.set()
    assert (await first).applied == {"path": "run.mcap"}


async def test_units_are_aligned_with_an_estimate_of_now_or_a_straight_arm(bench):
    upside_down = replace(result(), quaternions=np.tile([0.0, 1.0, 0.0, 0.0], (3, 1)))
    bench.estimator_state.update(upside_down, 0)
    for later_s, diagonal in ((0.1, [1.0, -1.0, -1.0]), (RECENT_S + 0.1, [1.0, 1.0, 1.0])):
        bench.now_ns = round(later_s * SECOND)
        await bench.send("calibrate/rest")
        assert bench.aligned == (np.diag(diagonal).tolist(), bench.now_ns)


async def test_units_are_aligned_only_while_the_arm_hangs_vented(bench):
    await bench.acquire()
    assert (await bench.send("calibrate/rest")).applied == {"aligned": ["imu"]}
    await bench.send("arm")
    refused = await bench.send("calibrate/rest")
    assert (refused.code, refused.hint) == ("wrong_mode", "disarm first")
