"""States and estimates of an arm, made by hand."""

from softarm_client import Estimate, Mismatch, State
from softarm_client.messages import (
    Contact,
    HealthFinding,
    LeaseState,
    LoadEstimate,
    SectionPose,
    Stamp,
)

BEGIN_NS = 1_795_000_000_250_000_000
LATENCY_S = 0.02
MILLISECOND_NS = 1_000_000
SECTIONS = (
    SectionPose(section="base", position_m=(0.0, 0.0, 0.0), quaternion_wxyz=(1.0, 0.0, 0.0, 0.0)),
    SectionPose(
        section="tip",
        position_m=(0.01, -0.02, 0.27),
        quaternion_wxyz=(0.8, 0.0, 0.6, 0.0),
        position_std_m=(1e-3, 2e-3, 3e-3),
        rotation_std_rad=(0.01, 0.02, 0.03),
    ),
)
LOAD = LoadEstimate(
    section="tip",
    force_n=(0.3, -0.1, 0.0),
    covariance_n2=((1e-4, 1e-5, None), (1e-5, 4e-4, None), (None, None, None)),
)


def stamp(after_ns=0):
    """A stamp so long after the beginning."""
    return Stamp(sequence=1, monotonic_ns=after_ns, unix_ns=BEGIN_NS + after_ns, source="fake")


def estimate(after_ns=0, **fields):
    """An estimate that converged, unless told otherwise."""
    values = {
        "stamp": stamp(after_ns),
        "status": "converged",
        "model": "fem",
        "loads": (LOAD,),
        "contact": Contact(height_m=0.2, height_std_m=0.01, force_n=(0.3, 0.0), since_unix_ns=BEGIN_NS),
        "in_contact": True,
        "tare_n": ((0.0, 0.0, 0.0),),
        "normalised_residual": 1.1,
        "degrees_of_freedom": 3,
        "unobservable": (),
        "sensors_used": ("orientation_tip",),
        "sensors_lost": (),
        "latency_s": LATENCY_S,
        "solve_s": 0.001,
    }
    return Estimate(**values | fields)


def state(after_ns=MILLISECOND_NS, **fields):
    """A state of an arm with two chambers, the second of which has lost its sensor."""
    values = {
        "stamp": stamp(after_ns),
        "mode": "HOLDING",
        "fault_cause": None,
        "findings": (),
        "asked_pa": (20e3, 10e3),
        "applied_pa": (19e3, 10e3),
        "measured_pa": (18.5e3, None),
        "sections": SECTIONS,
        "gauges_n": {},
        "ages_s": {"orientation_tip": 0.01, "valves": None},
        "lease": LeaseState(holder="somebody", remaining_s=0.5),
        "ticks": 12,
        "overruns": 0,
        "recording": None,
    }
    return State(**values | fields)


def mismatch(consistent=True):
    """A test of the model."""
    return Mismatch(
        stamp=stamp(),
        consistent=consistent,
        since_unix_ns=None,
        where=("orientation_tip",),
        normalised_innovation_squared=1.0,
        recording=None,
        advice="record it",
    )


def finding(severity, where="valves", message="no valid reading for 0.80 s"):
    """A finding of the service."""
    return HealthFinding(
        code="stale_sensor",
        where=where,
        severity=severity,
        message=message,
        hint="check its cable",
        since_unix_ns=BEGIN_NS,
    )
