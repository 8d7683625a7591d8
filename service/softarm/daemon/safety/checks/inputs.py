"""Sensors that are late or lost."""

from collections.abc import Iterator

from softarm.api.modes import Mode
from softarm.daemon.safety.findings import Finding, Severity
from softarm.daemon.safety.observation import Input, Observation

FOLLOWING_THE_POSE = frozenset({Mode.TEACH, Mode.HOLDING, Mode.EXPERIMENT})
"""Modes that cannot go on without knowing where the arm is."""


def check_inputs(observation: Observation) -> Iterator[Finding]:
    """Find stale streams; one that the mode needs is a fault."""
    blind = observation.mode in FOLLOWING_THE_POSE
    for entry in observation.inputs:
        if entry.stale:
            yield _stale(entry, "fault" if blind and entry.needed else "warning")
        elif entry.trouble:
            yield Finding("sensor_trouble", entry.name, "warning", entry.trouble, "see docs/drivers.md")


def _stale(entry: Input, severity: Severity) -> Finding:
    age = "no reading yet" if entry.age_s is None else f"no valid reading for {entry.age_s:.2f} s"
    consequence = "" if entry.needed else "; the others carry on and the covariance grows"
    return Finding("stale_sensor", entry.name, severity, age + consequence, "check its cable and its program")
