"""A control loop that comes late."""

from collections.abc import Iterator

from softarm.daemon.safety.diagnostics import Diagnostic
from softarm.daemon.safety.observation import ServiceHealth

OVERRUNS_ALLOWED = 5


def check_loop(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find a loop that skipped ticks."""
    if observation.overruns > OVERRUNS_ALLOWED and not observation.settling:
        message = f"{observation.overruns} control ticks were skipped in the last second"
        hint = "the machine is overloaded: end other programs, or give softarm a core"
        yield Diagnostic("loop_overrun", "control", "warning", message, hint)
