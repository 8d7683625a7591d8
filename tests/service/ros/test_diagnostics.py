"""The health of an arm as a DiagnosticArray."""

import pytest
from rosbags.typesys import Stores

from softarm_client.arm import STALE_S
from softarm_client.ros.diagnostics import Diagnostics
from softarm_client.ros.messages import FRESH_NS
from tests.service.ros.made import BEGIN_NS, MILLISECOND_NS, estimate, finding, mismatch, state
from tests.service.ros.typestore import Typestore

TYPES = Typestore(Stores.ROS2_JAZZY)
LEVEL = TYPES("diagnostic_msgs/msg/DiagnosticStatus")
LEVELS = {getattr(LEVEL, name): name for name in ("OK", "WARN", "ERROR", "STALE")}


class Clock:
    now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def diagnostics(clock):
    found = Diagnostics("sopra", TYPES, clock)
    found.note_estimate(estimate())
    found.note_mismatch(mismatch())
    found.note_state(state())
    return found


def report(diagnostics):
    """Read a report back from CDR: part to level, message and values."""
    message = TYPES.through_cdr(diagnostics.report())
    assert all(status.hardware_id == "sopra" for status in message.status)
    return {
        status.name.removeprefix("sopra: "): (
            LEVELS[status.level],
            status.message,
            {pair.key: pair.value for pair in status.values},
        )
        for status in message.status
    }


def test_every_part_of_a_healthy_arm_is_reported(diagnostics):
    parts = report(diagnostics)
    assert {part: level for part, (level, *_) in parts.items()} == dict.fromkeys(
        ("service", "estimate", "model", "orientation_tip", "valves"), "OK"
    )
    assert parts["service"][1] == "HOLDING"
    assert parts["service"][2]["lease holder"] == "somebody"
    assert parts["estimate"][2]["contact height [m]"] == "0.2"
    age = "age of the last valid reading [s]"
    assert (parts["orientation_tip"][2][age], parts["valves"][2][age]) == ("0.010", "never")


@pytest.mark.parametrize(
    ("severity", "level"), [("info", "OK"), ("warning", "WARN"), ("fault", "ERROR"), ("newer", "WARN")]
)
def test_a_finding_stands_at_its_place_until_it_clears(diagnostics, severity, level):
    diagnostics.note_state(state(findings=(finding(severity), finding("info", "disk", "nearly full"))))
    parts = report(diagnostics)
    assert parts["valves"][:2] == (level, "no valid reading for 0.80 s")
    assert parts["valves"][2]["stale_sensor"] == "check its cable"
    assert parts["disk"][1] == "nearly full"
    diagnostics.note_state(state())
    assert report(diagnostics)["disk"][:2] == report(diagnostics)["valves"][:2] == ("OK", "no finding")


def test_a_fault_is_an_error_with_its_cause(diagnostics):
    diagnostics.note_state(state(mode="FAULTED", fault_cause="valves lost"))
    assert report(diagnostics)["service"][:2] == ("ERROR", "FAULTED: valves lost")


@pytest.mark.parametrize(
    ("fields", "level"),
    [
        ({"status": "degraded"}, "WARN"),
        ({"status": "not_converged"}, "ERROR"),
        ({"status": "newer"}, "ERROR"),
    ],
)
def test_the_estimate_has_the_level_of_its_status(diagnostics, fields, level):
    diagnostics.note_estimate(estimate(**fields))
    assert report(diagnostics)["estimate"][:2] == (level, fields["status"])


def test_an_estimate_that_stopped_is_stale(diagnostics, clock):
    assert report(Diagnostics("sopra", TYPES, clock))["service"][0] == "STALE"
    diagnostics.note_state(state(FRESH_NS + 300 * MILLISECOND_NS))
    assert report(diagnostics)["estimate"] == ("STALE", "no estimate for 0.8 s", {})


def test_a_model_that_differs_is_a_warning_with_advice(diagnostics):
    diagnostics.note_mismatch(mismatch(consistent=False))
    level, _, values = report(diagnostics)["model"]
    assert (level, values["where"], values["advice"]) == ("WARN", "orientation_tip", "record it")


def test_a_silent_service_makes_every_part_stale_on_the_arm_s_clock(diagnostics, clock):
    healthy = report(diagnostics)
    clock.now_s += STALE_S + 1.5
    stale = report(diagnostics)
    assert set(stale) == set(healthy)
    assert {part[:2] for part in stale.values()} == {("STALE", "nothing received from the service for 2.0 s")}
    stamp = diagnostics.report().message.header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == BEGIN_NS + MILLISECOND_NS + 2 * 10**9
