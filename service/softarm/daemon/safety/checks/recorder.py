"""A recorder that loses data."""

from collections.abc import Iterator

from softarm.daemon.safety.findings import Finding
from softarm.daemon.safety.observation import Observation


def check_recorder(observation: Observation) -> Iterator[Finding]:
    """Find a recording that failed or dropped messages; the arm is not affected."""
    recorder = observation.recorder
    if recorder.error:
        yield Finding(
            "recorder_failed", "recorder", "warning", recorder.error, "free the disk, then record/start again"
        )
    elif recorder.active and recorder.dropped:
        message = f"{recorder.dropped} messages of this recording were dropped"
        yield Finding("recorder_dropped", "recorder", "warning", message, "the disk is too slow or too busy")
