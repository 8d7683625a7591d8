"""A disk that fills up."""

from collections.abc import Iterator

from softarm.daemon.safety.diagnostics import Diagnostic
from softarm.daemon.safety.observation import Observation

LOW_BYTES = 500_000_000


def check_disk(observation: Observation) -> Iterator[Diagnostic]:
    """Find too little space for a recording."""
    free = observation.recorder.free_bytes
    if free is not None and free < LOW_BYTES:
        message = f"{free / 1e6:.0f} MB are left for recordings"
        yield Diagnostic("disk_full", "recorder", "warning", message, "move old recordings away")
