"""Sensors that are late or lost."""

from collections.abc import Iterator

from softarm.daemon.safety.diagnostics import Diagnostic, Severity
from softarm.daemon.safety.observation import Input, ServiceHealth
from softarm_client.modes import Mode

FOLLOWING_THE_POSE = frozenset({Mode.TEACH, Mode.HOLDING, Mode.EXPERIMENT})
"""Modes that cannot go on without knowing where the arm is."""


def check_inputs(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find stale streams; one that the mode needs is a fault."""
    blind = observation.mode in FOLLOWING_THE_POSE
    for entry in observation.inputs:
        severity: Severity = "fault" if blind and entry.needed else "warning"
        if entry.stale and not (severity == "warning" and observation.settling):
            yield _stale(entry, severity, observation.busy)
        elif entry.trouble and not entry.stale and not observation.settling:
            yield Diagnostic("sensor_trouble", entry.name, "warning", entry.trouble, "see docs/drivers.md")


def _stale(entry: Input, severity: Severity, busy: str) -> Diagnostic:
    age = "no reading yet" if entry.age_s is None else f"no valid reading for {entry.age_s:.2f} s"
    consequence = (
        "" if entry.needed else "; the estimator continues with the other sensors, and the covariance grows"
    )
    if busy:
        hint = "the processor is late, perhaps not the sensor: end other programs, or give softarm a core"
        return Diagnostic("stale_sensor", entry.name, severity, f"{age}, while {busy}{consequence}", hint)
    hint = entry.trouble or "check its cable, its power and its program"
    return Diagnostic("stale_sensor", entry.name, severity, age + consequence, hint)
