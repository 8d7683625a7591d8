"""A disk that fills up."""

from collections.abc import Iterator

from softarm.daemon.safety.diagnostics import Diagnostic
from softarm.daemon.safety.observation import ServiceHealth

RESERVE_BYTES = 500_000_000
"""A recording ends while so much space is left: a full disk would stop other programs too."""
LOW_BYTES = 2 * RESERVE_BYTES


def check_disk(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find too little space for a recording."""
    free = observation.recorder.free_bytes
    if free is not None and free < LOW_BYTES:
        message = f"{free / 1e6:.0f} MB are left on the disk; recordings end at {RESERVE_BYTES / 1e6:.0f} MB"
        yield Diagnostic("disk_full", "recorder", "warning", message, "move old recordings to another disk")
