from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from softarm.daemon.safety.checks import (
    ALL_CHECKS,
    FAILURES_ALLOWED,
    MODES_USING_THE_ESTIMATE,
    MODES_USING_THE_POSE,
)
from softarm.daemon.safety.diagnostics import HealthMonitor
from softarm.daemon.safety.modes import PRESSURISED, Mode
from softarm.daemon.safety.observation import (
    SETTLING_S,
    DeviceStatus,
    EstimatorHealth,
    Input,
    RecorderHealth,
    ServiceHealth,
    Valves,
)

HEALTHY = ServiceHealth(
    mode=Mode.ARMED,
    valves=Valves("valves", age_s=0.01, deadline_s=0.1),
    inputs=(
        Input("qtm/tip", needed=True, age_s=0.01, deadline_s=0.1),
        Input("bend", needed=False, age_s=0.01, deadline_s=0.1),
    ),
    estimator=EstimatorHealth(running=True, age_s=0.01, deadline_s=0.2),
    recorder=RecorderHealth(active=False, dropped=0, error="", free_bytes=10**12),
    overruns=0,
)
LOST_VALVES = replace(HEALTHY.valves, age_s=1.0)
STALE_TIP = (replace(HEALTHY.inputs[0], age_s=1.0), HEALTHY.inputs[1])
DEAD_ESTIMATOR = replace(HEALTHY.estimator, running=False)


def faults(observation):
    return {finding.code for finding in HealthMonitor(ALL_CHECKS).faults(observation)}


@given(st.sampled_from(Mode))
def test_healthy_service_has_no_finding(mode):
    assert HealthMonitor(ALL_CHECKS).evaluate(replace(HEALTHY, mode=mode)) == ()


@given(st.sampled_from(Mode))
def test_lost_valves_fault_every_pressurised_mode_and_no_other(mode):
    found = faults(replace(HEALTHY, mode=mode, valves=LOST_VALVES))
    assert found == ({"valves_lost"} if mode in PRESSURISED else set())


@given(st.sampled_from(Mode))
def test_needed_sensor_faults_the_modes_that_follow_the_pose(mode):
    found = faults(replace(HEALTHY, mode=mode, inputs=STALE_TIP))
    assert found == ({"stale_sensor"} if mode in MODES_USING_THE_POSE else set())


@given(st.sampled_from(Mode))
def test_dead_estimator_faults_the_modes_that_follow_the_pose(mode):
    found = faults(replace(HEALTHY, mode=mode, estimator=DEAD_ESTIMATOR))
    assert found == ({"estimator_failed"} if mode in MODES_USING_THE_POSE else set())


@given(st.sampled_from(Mode))
def test_spare_sensor_disk_and_overruns_never_fault(mode):
    spare_lost = (HEALTHY.inputs[0], replace(HEALTHY.inputs[1], age_s=None))
    full = RecorderHealth(active=True, dropped=3, error="no space left", free_bytes=0)
    observation = replace(HEALTHY, mode=mode, inputs=spare_lost, recorder=full, overruns=99)
    assert faults(observation) == set()
    assert {f.code for f in HealthMonitor(ALL_CHECKS).evaluate(observation)} == {
        "stale_sensor",
        "recorder_failed",
        "disk_full",
        "loop_overrun",
    }


def test_finding_keeps_its_beginning_and_clears_itself():
    book = HealthMonitor(ALL_CHECKS, clear_after_ns=100)
    lost = replace(HEALTHY, valves=LOST_VALVES)
    new, cleared = book.update(lost, now_ns=0, unix_ns=5)
    assert [f.code for f in new] == ["valves_lost"]
    assert cleared == ()
    older = replace(lost, valves=replace(LOST_VALVES, age_s=2.0))
    assert book.update(older, now_ns=10, unix_ns=6) == ((), ())
    assert [s.since_unix_ns for s in book.active] == [5]
    assert book.update(HEALTHY, now_ns=20, unix_ns=7) == ((), ())
    new, cleared = book.update(HEALTHY, now_ns=111, unix_ns=8)
    assert (new, [f.code for f in cleared], book.active) == ((), ["valves_lost"], ())


@given(st.lists(st.booleans(), min_size=100, max_size=300))
def test_finding_that_flaps_is_reported_at_most_once_in_two_seconds(lost):
    book, reported = HealthMonitor(ALL_CHECKS), 0
    for tick, gone in enumerate(lost):  # a tick each 10 ms
        observation = replace(HEALTHY, inputs=STALE_TIP) if gone else HEALTHY
        new, cleared = book.update(observation, tick * 10_000_000, unix_ns=tick)
        reported += len(new) + len(cleared)
        # What acts on the arm neither waits nor lingers.
        assert bool(book.present_faults) is False
    assert reported <= 2 * (1 + len(lost) // 200)


def test_fault_acts_at_once_and_does_not_linger():
    book = HealthMonitor(ALL_CHECKS)
    book.update(replace(HEALTHY, mode=Mode.TEACH, inputs=STALE_TIP), 0, 0)
    assert [f.code for f in book.present_faults] == ["stale_sensor"]
    book.update(replace(HEALTHY, mode=Mode.TEACH), 10_000_000, 1)
    assert book.present_faults == ()
    assert [s.finding.code for s in book.active] == ["stale_sensor"]


NOTHING_YET = replace(
    HEALTHY,
    mode=Mode.STARTING,
    valves=replace(HEALTHY.valves, age_s=None),
    inputs=tuple(replace(entry, age_s=None) for entry in HEALTHY.inputs),
    estimator=EstimatorHealth(running=False, age_s=None, deadline_s=0.2, starting=True),
    devices=(DeviceStatus("gauge", connected=False),),
    uptime_s=0.1,
)


def test_normal_start_has_no_finding_and_still_cannot_be_armed():
    assert HealthMonitor(ALL_CHECKS).evaluate(NOTHING_YET) == ()
    assert faults(replace(NOTHING_YET, mode=Mode.ARMED)) == {"valves_lost"}
    assert faults(replace(NOTHING_YET, mode=Mode.TEACH)) == {
        "valves_lost",
        "stale_sensor",
        "estimator_failed",
    }


def test_building_the_estimator_on_busy_processors_raises_no_warning_until_it_is_done():
    late = replace(HEALTHY, inputs=STALE_TIP, overruns=50, busy="the control loop came 60 ms late")
    assert HealthMonitor(ALL_CHECKS).evaluate(replace(late, mode=Mode.STARTING)) == ()
    assert {f.code for f in HealthMonitor(ALL_CHECKS).evaluate(replace(late, mode=Mode.IDLE))} == {
        "stale_sensor",
        "loop_overrun",
    }


def test_what_has_not_answered_after_a_while_is_found():
    found = HealthMonitor(ALL_CHECKS).evaluate(replace(NOTHING_YET, uptime_s=SETTLING_S))
    assert {f.code for f in found} == {"valves_lost", "stale_sensor", "device_lost"}


GAUGE = DeviceStatus("gauge", connected=True, age_s=0.01)


@pytest.mark.parametrize(
    ("device", "code", "hint"),
    [
        (
            replace(GAUGE, connected=False, error="cannot be reached", cure="plug it in"),
            "device_lost",
            "plug it in",
        ),
        (
            replace(GAUGE, connected=False, error="no gauge", gave_up=True),
            "device_gave_up",
            "device/reconnect",
        ),
        (replace(GAUGE, measured=False, age_s=2.0), "device_silent", "measures"),
        (replace(GAUGE, measured=False, age_s=None), "device_silent", "measures"),
        (replace(GAUGE, sink_errors=3), "sink_failed", "log"),
    ],
)
@given(mode=st.sampled_from(Mode))
def test_every_configured_device_is_judged_in_every_mode(device, code, hint, mode):
    (finding,) = HealthMonitor(ALL_CHECKS).evaluate(replace(HEALTHY, mode=mode, devices=(GAUGE, device)))
    assert (finding.code, finding.where, finding.severity) == (code, "gauge", "warning")
    assert hint in finding.hint


def test_silence_on_a_late_processor_is_reported_as_such():
    busy = "the control loop came 80 ms late"
    stale = replace(HEALTHY, mode=Mode.TEACH, inputs=STALE_TIP, valves=LOST_VALVES, busy=busy)
    for finding in HealthMonitor(ALL_CHECKS).evaluate(stale):
        assert finding.severity == "fault"
        assert busy in finding.message
        assert "processor" in finding.hint
        assert "cable" not in finding.hint


def test_estimator_that_is_not_started_again_is_said_to_be_so():
    gone = replace(HEALTHY.estimator, running=False, gave_up=True)
    (finding,) = HealthMonitor(ALL_CHECKS).evaluate(replace(HEALTHY, estimator=gone))
    assert "does not start it again" in finding.message
    assert "restart the service" in finding.hint


LATE = replace(HEALTHY.estimator, age_s=1.0)


@pytest.mark.parametrize(
    ("estimator", "busy", "words", "hint"),
    [
        (LATE, "", "returns no results", "a sensor may be lost"),
        (LATE, "the control loop came 80 ms late", "came 80 ms late", "processor"),
        (replace(HEALTHY.estimator, age_s=None), "", "returns no results", "a sensor may be lost"),
        (replace(HEALTHY.estimator, failures=FAILURES_ALLOWED + 1), "", "21 estimates in a row", "calibrate"),
        (replace(HEALTHY.estimator, running=False), "", "is not running", "restarts it"),
    ],
)
@given(mode=st.sampled_from(Mode))
def test_an_estimator_that_cannot_be_relied_on_is_named_with_its_cause(estimator, busy, words, hint, mode):
    observation = replace(HEALTHY, mode=mode, estimator=estimator, busy=busy)
    found = [f for f in HealthMonitor(ALL_CHECKS).evaluate(observation) if f.code == "estimator_failed"]
    if busy and mode is Mode.STARTING:
        return
    (finding,) = found
    assert words in finding.message
    assert hint in finding.hint
    steered = MODES_USING_THE_ESTIMATE if estimator.failures else MODES_USING_THE_POSE
    assert finding.severity == ("fault" if mode in steered else "warning")


@given(st.integers(0, FAILURES_ALLOWED), st.sampled_from(Mode))
def test_a_few_estimates_that_do_not_converge_are_nothing(failures, mode):
    estimator = replace(HEALTHY.estimator, failures=failures)
    assert HealthMonitor(ALL_CHECKS).evaluate(replace(HEALTHY, mode=mode, estimator=estimator)) == ()


def test_a_recording_that_loses_messages_is_named_and_the_arm_goes_on():
    recorder = RecorderHealth(active=True, dropped=3, error="", free_bytes=10**12)
    (finding,) = HealthMonitor(ALL_CHECKS).evaluate(replace(HEALTHY, recorder=recorder))
    assert (finding.code, finding.severity) == ("recorder_dropped", "warning")
    assert "3 messages" in finding.message
