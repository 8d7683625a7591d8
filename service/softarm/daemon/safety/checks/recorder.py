"""A recorder that loses data."""

from collections.abc import Iterator

from softarm.daemon.safety.diagnostics import Diagnostic
from softarm.daemon.safety.observation import ServiceHealth


def check_recorder(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find a recording that failed or dropped messages; the arm is not affected."""
    recorder = observation.recorder
    if recorder.error:
        yield Diagnostic(
            "recorder_failed", "recorder", "warning", recorder.error, "free the disk, then record/start again"
        )
    elif recorder.active and recorder.dropped:
        message = f"{recorder.dropped} messages of this recording were dropped"
        yield Diagnostic(
            "recorder_dropped", "recorder", "warning", message, "the disk is too slow or too busy"
        )
