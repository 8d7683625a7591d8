"""Lost or untrustworthy valves."""

from collections.abc import Iterator

from softarm.daemon.safety.diagnostics import Diagnostic, Severity
from softarm.daemon.safety.modes import PRESSURISED
from softarm.daemon.safety.observation import ServiceHealth


def check_valves(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find a valve bank that does not answer, or whose outputs are not those commanded."""
    valves = observation.valves
    severity: Severity = "fault" if observation.mode in PRESSURISED else "warning"
    quiet = severity == "warning" and observation.settling
    if valves.lost and not quiet:
        age = "never answered" if valves.age_s is None else f"has not answered for {valves.age_s:.2f} s"
        message, hint = (
            f"the valve bank {age}",
            "check power, network and address; the watchdog of the terminal vents meanwhile",
        )
        if observation.busy and valves.age_s is not None:
            message = f"{message}, while {observation.busy}"
            hint = "the processor is late, perhaps not the valves: end other programs, or give softarm a core"
        yield Diagnostic("valves_lost", valves.name, severity, message, hint)
    for fault in valves.faults:
        yield Diagnostic(
            "valve_fault", valves.name, severity, fault, "see the valve bank's diagnosis, then clear"
        )
    for warning in () if quiet else valves.warnings:
        yield Diagnostic("valve_warning", valves.name, "warning", warning, "see docs/drivers.md")
