"""The texts of the page: numbers with units, and nothing of others that is not escaped."""

import re

import pytest

from softarm.page import readings
from softarm_client.messages import (
    Contact,
    Estimate,
    HealthFinding,
    LeaseState,
    LoadEstimate,
    Mismatch,
    SectionPose,
    Stamp,
    State,
)

STAMP = Stamp(sequence=1, monotonic_ns=1, unix_ns=1, source="fake")
EVIL = "<img src=x onerror=alert(1)>\"'&"
TIP = SectionPose(
    section="tip", position_m=(0.0123, -0.0049, 0.27), quaternion_wxyz=(0.99619470, 0.0871557, 0.0, 0.0)
)


def finding(where, severity, message="it is late"):
    return HealthFinding(
        code="x", where=where, severity=severity, message=message, hint="see there", since_unix_ns=1
    )


def state(**changes):
    known = {
        "stamp": STAMP,
        "mode": "IDLE",
        "fault_cause": None,
        "findings": (),
        "asked_pa": (0.0, 0.0),
        "applied_pa": (0.0, 0.0),
        "measured_pa": (0.0, None),
        "gauges_n": {},
        "sections": (TIP,),
        "ages_s": {"orientation_tip": 0.012, "valves": None},
        "lease": LeaseState(holder=None, remaining_s=0.0),
        "ticks": 1,
        "overruns": 0,
        "recording": None,
    }
    return State(**(known | changes))


def estimate(**changes):
    known_axes = (1e-3, 0.0, None), (0.0, 1e-3, None), (None, None, None)
    load = LoadEstimate(section="tip", force_n=(0.4, 0.1, 0.0), covariance_n2=known_axes)
    known = {
        "stamp": STAMP,
        "status": "converged",
        "model": "fem",
        "loads": (load,),
        "contact": Contact(height_m=0.182, height_std_m=0.006, force_n=(0.4, 0.1), since_unix_ns=1),
        "in_contact": True,
        "tare_n": (),
        "normalised_residual": 1.0,
        "degrees_of_freedom": 3,
        "unobservable": (),
        "sensors_used": ("orientation_tip",),
        "sensors_lost": (),
        "latency_s": 0.02,
        "solve_s": 0.01,
    }
    return Estimate(**(known | changes))


def mismatch(**changes):
    known = {
        "stamp": STAMP,
        "consistent": False,
        "since_unix_ns": 1,
        "where": ("bend_tip",),
        "normalised_innovation_squared": 7.3,
        "recording": "/data/mismatch_1.mcap",
        "advice": "calibrate",
    }
    return Mismatch(**(known | changes))


def test_texts_of_others_are_escaped_in_every_block():
    evil = state(
        mode=EVIL,
        fault_cause=EVIL,
        findings=(finding(EVIL, "fault", EVIL), finding("tip", EVIL)),
        ages_s={EVIL: 0.1},
        lease=LeaseState(holder=EVIL, remaining_s=1.0),
        recording=f"/data/{EVIL}",
        teach_note=EVIL,
    )
    blocks = [
        readings.status(evil),
        readings.lost_service(1.0, evil),
        readings.instruments(evil),
        readings.recording(evil),
        readings.forces((), (TIP.model_copy(update={"section": EVIL}),), ""),
        readings.quality(estimate(status=EVIL, sensors_lost=(EVIL,))),
        readings.model(mismatch(where=(EVIL,), advice=EVIL, recording=f"/data/{EVIL}")),
    ]
    for block in blocks:
        assert "onerror" in block
        assert "<img" not in block
        assert EVIL not in re.sub(r"<[^<>]*>", "", block)


def test_faults_stand_above_warnings_and_the_mode_is_explained():
    shown = readings.status(state(mode="FAULTED", findings=(finding("a", "warning"), finding("b", "fault"))))
    assert shown.index('class="fault">b') < shown.index('class="warning">a')
    assert "press Clear" in shown


def test_every_mode_is_explained():
    from softarm_client.modes import Mode

    assert set(readings.MODE_DESCRIPTIONS) == set(Mode)


def test_forces_are_newtons_with_their_deviation_poses_millimetres_and_degrees():
    shown = readings.forces(estimate().loads, (TIP,), readings.quality(estimate()))
    # Both known axes of the covariance are 1e-3 N^2: 0.032 N along each, not the 0.045 N of their sum.
    assert "<b>0.412</b> ± 0.032" in shown
    assert "<td>12, -5, 270</td><td>10.0°</td>" in shown
    assert "Contact 182 ± 6 mm from the base" in shown


def test_a_section_that_has_not_moved_is_at_zero_without_a_sign():
    still = TIP.model_copy(update={"position_m": (1e-6, -1e-6, 0.27)})
    assert "<td>0, 0, 270</td>" in readings.forces((), (still,), "")


def test_bars_end_at_the_limit_of_the_chamber_and_a_lost_pressure_is_named():
    kinds = {"set-point": (20e3, 0.0), "applied": (10e3, 0.0), "measured": (5e3, None)}
    shown = readings.pressures(kinds, (40e3, 40e3))
    widths = re.findall(r'class="([\w-]+)" style="top:\d+px;width:([\d.]+)%"', shown)
    assert widths[:3] == [("set-point", "50.0"), ("applied", "25.0"), ("measured", "12.5")]
    assert "lost" in shown
    beyond = readings.pressures({"set-point": (90e3, -1.0)}, (40e3, 40e3))
    assert re.findall(r'"set-point" style="top:0px;width:([\d.]+)%', beyond) == ["100.0", "0.0"]


@pytest.mark.parametrize(
    ("findings", "kind"), [((), ""), ((finding("orientation_tip", "warning"),), "warning")]
)
def test_instruments_carry_the_colour_of_their_finding(findings, kind):
    shown = readings.instruments(state(findings=(*findings, finding("recorder", "fault"))))
    assert f'<span class="dot {kind}"></span>orientation&#95;tip 12 ms' in shown
    assert '<span class="dot warning"></span>valves no reading' in shown
    assert '<span class="dot fault"></span>recorder </span>' in shown


def test_disagreement_names_the_place_the_remedy_and_the_recording():
    shown = readings.model(mismatch())
    assert "They differ at bend&#95;tip" in shown
    assert "calibrate" in shown
    assert "mismatch&#95;1&#46;mcap" in shown
    assert "They agree" in readings.model(mismatch(consistent=True))
