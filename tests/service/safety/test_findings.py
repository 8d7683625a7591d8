from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from softarm.daemon.safety.checks import ALL_CHECKS
from softarm.daemon.safety.checks.inputs import FOLLOWING_THE_POSE
from softarm.daemon.safety.findings import FindingBook
from softarm.daemon.safety.modes import PRESSURISED, Mode
from softarm.daemon.safety.observation import Estimator, Input, Observation, Recorder, Valves

HEALTHY = Observation(
    mode=Mode.ARMED,
    valves=Valves("valves", age_s=0.01, deadline_s=0.1),
    inputs=(
        Input("qtm/tip", needed=True, age_s=0.01, deadline_s=0.1),
        Input("bend", needed=False, age_s=0.01, deadline_s=0.1),
    ),
    estimator=Estimator(running=True, age_s=0.01, deadline_s=0.2),
    recorder=Recorder(active=False, dropped=0, error="", free_bytes=10**12),
    overruns=0,
)
LOST_VALVES = replace(HEALTHY.valves, age_s=1.0)
STALE_TIP = (replace(HEALTHY.inputs[0], age_s=1.0), HEALTHY.inputs[1])
DEAD_ESTIMATOR = replace(HEALTHY.estimator, running=False)


def faults(observation):
    return {finding.code for finding in FindingBook(ALL_CHECKS).faults(observation)}


@given(st.sampled_from(Mode))
def test_healthy_service_has_no_finding(mode):
    assert FindingBook(ALL_CHECKS).evaluate(replace(HEALTHY, mode=mode)) == ()


@given(st.sampled_from(Mode))
def test_lost_valves_fault_every_pressurised_mode_and_no_other(mode):
    found = faults(replace(HEALTHY, mode=mode, valves=LOST_VALVES))
    assert found == ({"valves_lost"} if mode in PRESSURISED else set())


@given(st.sampled_from(Mode))
def test_needed_sensor_faults_the_modes_that_follow_the_pose(mode):
    found = faults(replace(HEALTHY, mode=mode, inputs=STALE_TIP))
    assert found == ({"stale_sensor"} if mode in FOLLOWING_THE_POSE else set())


@given(st.sampled_from(Mode))
def test_dead_estimator_faults_the_modes_that_follow_the_pose(mode):
    found = faults(replace(HEALTHY, mode=mode, estimator=DEAD_ESTIMATOR))
    assert found == ({"estimator_failed"} if mode in FOLLOWING_THE_POSE else set())


@given(st.sampled_from(Mode))
def test_spare_sensor_disk_and_overruns_never_fault(mode):
    spare_lost = (HEALTHY.inputs[0], replace(HEALTHY.inputs[1], age_s=None))
    full = Recorder(active=True, dropped=3, error="no space left", free_bytes=0)
    observation = replace(HEALTHY, mode=mode, inputs=spare_lost, recorder=full, overruns=99)
    assert faults(observation) == set()
    assert {f.code for f in FindingBook(ALL_CHECKS).evaluate(observation)} == {
        "stale_sensor",
        "recorder_failed",
        "disk_full",
        "loop_overrun",
    }


def test_finding_keeps_its_beginning_and_clears_itself():
    book = FindingBook(ALL_CHECKS)
    lost = replace(HEALTHY, valves=LOST_VALVES)
    new, cleared = book.update(lost, unix_ns=5)
    assert [f.code for f in new] == ["valves_lost"]
    assert cleared == ()
    assert book.update(replace(lost, valves=replace(LOST_VALVES, age_s=2.0)), unix_ns=6) == ((), ())
    assert [s.since_unix_ns for s in book.standing] == [5]
    new, cleared = book.update(HEALTHY, unix_ns=7)
    assert (new, [f.code for f in cleared], book.standing) == ((), ["valves_lost"], ())
