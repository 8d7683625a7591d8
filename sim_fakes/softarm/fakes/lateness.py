"""Reports when the fakes lack processor time: their silence then is no fault of a device."""

from collections.abc import Callable

from softarm.fakes.clock import Clock

EVERY_S = 0.05
LATE_S = 0.1
"""Half of the service's valve deadline, and about half of the terminal's watchdog."""


async def watch_lateness(clock: Clock, report: Callable[[str], None]) -> None:
    """Watch how late the fakes' own loop runs, report the first time it is too late, and end."""
    while True:
        due = clock.now() + EVERY_S
        await clock.sleep_until(due)
        late_s = clock.now() - due
        if late_s > LATE_S:
            report(
                f"fakes: this machine is busy: the fakes themselves came {1e3 * late_s:.0f} ms late, so a "
                "service may find them silent; end other programs"
            )
            return
