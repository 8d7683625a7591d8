"""The health checks of the service: each reports what is wrong with one part of it."""

from collections.abc import Iterator

from softarm.daemon.safety.diagnostics import Diagnostic, Severity
from softarm.daemon.safety.modes import PRESSURISED
from softarm.daemon.safety.observation import DeviceStatus, Input, ServiceHealth
from softarm_client.modes import Mode

REDUCE_THE_LOAD = "end other programs, or reserve a processor core for softarm"


def _silence(age_s: float | None) -> str:
    return "no reading yet" if age_s is None else f"no valid reading for {age_s:.2f} s"


def check_valves(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find a valve bank that does not answer, or whose outputs are not those commanded."""
    valves = observation.valves
    # Nothing excuses silent valves under pressure, neither a start a moment ago nor a busy processor.
    severity: Severity = "fault" if observation.mode in PRESSURISED else "warning"
    quiet = severity == "warning" and observation.settling
    if valves.lost and not quiet:
        age = "never answered" if valves.age_s is None else f"has not answered for {valves.age_s:.2f} s"
        message = f"the valve bank {age}"
        hint = "check power, network and address; the watchdog of the terminal vents in the meantime"
        if observation.busy and valves.age_s is not None:
            message = f"{message}, while {observation.busy}"
            hint = f"the processor is late, perhaps not the valves: {REDUCE_THE_LOAD}"
        yield Diagnostic("valves_lost", valves.name, severity, message, hint)
    for fault in valves.faults:
        yield Diagnostic(
            "valve_fault", valves.name, severity, fault, "see the valve bank's diagnosis, then clear"
        )
    for warning in () if quiet else valves.warnings:
        yield Diagnostic("valve_warning", valves.name, "warning", warning, "see docs/drivers.md")


MODES_USING_THE_POSE = frozenset({Mode.TEACH, Mode.HOLDING, Mode.EXPERIMENT})
"""Modes that cannot go on without knowing where the arm is."""


def check_inputs(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find stale streams; one that the mode needs is a fault."""
    blind = observation.mode in MODES_USING_THE_POSE
    for entry in observation.inputs:
        severity: Severity = "fault" if blind and entry.needed else "warning"
        if entry.stale and not (severity == "warning" and observation.settling):
            yield _stale(entry, severity, observation.busy)
        # A device's trouble that shows as silence is the hint of that finding, not a second one.
        elif entry.trouble and not entry.stale and not observation.settling:
            yield Diagnostic("sensor_trouble", entry.name, "warning", entry.trouble, "see docs/drivers.md")


def _stale(entry: Input, severity: Severity, busy: str) -> Diagnostic:
    age = _silence(entry.age_s)
    consequence = (
        "" if entry.needed else "; the estimator continues with the other sensors, and the covariance grows"
    )
    if busy:
        hint = f"the processor is late, perhaps not the sensor: {REDUCE_THE_LOAD}"
        return Diagnostic("stale_sensor", entry.name, severity, f"{age}, while {busy}{consequence}", hint)
    hint = entry.trouble or "check its cable, its power and its program"
    return Diagnostic("stale_sensor", entry.name, severity, age + consequence, hint)


def check_devices(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find what is wrong with each configured instrument; what the mode needs is judged by its inputs."""
    for device in observation.devices:
        if device.sink_errors:
            message = f"{device.sink_errors} of its readings could not be processed: an internal error"
            yield Diagnostic(
                "sink_failed", device.name, "warning", message, "report this with the service's log"
            )
        yield from _connection(device, observation)


def _connection(device: DeviceStatus, observation: ServiceHealth) -> Iterator[Diagnostic]:
    if device.gave_up:
        hint = f"{device.cure}; then command device/reconnect"
        yield Diagnostic(
            "device_gave_up", device.name, "warning", f"{device.error}; the service does not retry", hint
        )
    elif not device.connected and (device.error or not observation.settling):
        message = device.error or "is not connected yet"
        hint = device.cure or "check its cable, its power and its address"
        yield Diagnostic("device_lost", device.name, "warning", message, f"{hint}; the service keeps trying")
    elif device.connected and not device.measured and device.silent and not observation.settling:
        age = _silence(device.age_s)
        message = f"{age}, while {observation.busy}" if observation.busy else age
        yield Diagnostic("device_silent", device.name, "warning", message, "check that it measures")


FAILURES_ALLOWED = 20
"""A fifth of a second at 100 Hz: an arm that is pushed may cost a few estimates."""
MODES_USING_THE_ESTIMATE = frozenset({Mode.TEACH, Mode.HOLDING})
"""Modes whose pressures come from the estimate; an experiment applies its own and may excite oscillations."""


def check_estimator(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find an estimator on which the mode can no longer rely."""
    estimator = observation.estimator
    severity: Severity = "fault" if observation.mode in MODES_USING_THE_POSE else "warning"
    if estimator.starting:
        if severity == "warning":
            return  # a start is no trouble; only a mode that needs the pose is refused meanwhile
        message, hint = "the estimator is still being built", "wait until it is ready"
    elif estimator.gave_up:
        message = "the estimator's process died too often; the service does not start it again"
        hint = "see the log for the cause, then restart the service"
    elif not estimator.running:
        message, hint = "the estimator's process is not running", "the service restarts it; see the log"
    elif estimator.age_s is None or estimator.age_s > estimator.deadline_s:
        message, hint = "the estimator returns no results", "a sensor may be lost: see the other findings"
        if observation.busy:
            message = f"{message}, while {observation.busy}"
            hint = f"the processor is late: {REDUCE_THE_LOAD}"
    elif estimator.failures > FAILURES_ALLOWED:
        message = f"{estimator.failures} estimates in a row did not converge"
        hint = "the model does not fit the arm: calibrate, or run softarm diagnose on a recording"
        severity = "fault" if observation.mode in MODES_USING_THE_ESTIMATE else "warning"
    else:
        return
    yield Diagnostic("estimator_failed", "estimator", severity, message, hint)


def check_recorder(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find a recording that failed or dropped messages; the arm is not affected."""
    recorder = observation.recorder
    if recorder.error:
        yield Diagnostic(
            "recorder_failed",
            "recorder",
            "warning",
            recorder.error,
            "free space on the disk, then record/start again",
        )
    elif recorder.active and recorder.dropped:
        message = f"{recorder.dropped} messages of this recording were dropped"
        yield Diagnostic(
            "recorder_dropped", "recorder", "warning", message, "the disk is too slow or too busy"
        )


RESERVE_BYTES = 500_000_000
"""A recording ends while so much space is left: a full disk would stop other programs too."""
LOW_BYTES = 2 * RESERVE_BYTES


def check_disk(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find too little space for a recording."""
    free = observation.recorder.free_bytes
    if free is not None and free < LOW_BYTES:
        message = f"{free / 1e6:.0f} MB are left on the disk; recordings end at {RESERVE_BYTES / 1e6:.0f} MB"
        yield Diagnostic("disk_full", "recorder", "warning", message, "move old recordings to another disk")


OVERRUNS_ALLOWED = 5


def check_loop(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find a loop that skipped ticks."""
    if observation.overruns > OVERRUNS_ALLOWED and not observation.settling:
        message = f"{observation.overruns} control ticks were skipped in the last second"
        hint = f"the machine is overloaded: {REDUCE_THE_LOAD}"
        yield Diagnostic("loop_overrun", "control", "warning", message, hint)


ALLOWED_DEGREES = 0.5


def check_rod(observation: ServiceHealth) -> Iterator[Diagnostic]:
    """Find a rod that its last comparison showed to be off."""
    off = observation.estimator.rod_off_degrees
    if off is not None and off > ALLOWED_DEGREES:
        message = f"the calibrated rod is {off:.2g} degrees away from the finite elements"
        hint = 'the arm is outside the range in which the rod was fitted: set control.model = "fem"'
        yield Diagnostic("rod_off", "estimator", "warning", message, hint)


ALL_CHECKS = (
    check_valves,
    check_inputs,
    check_devices,
    check_estimator,
    check_recorder,
    check_disk,
    check_loop,
    check_rod,
)
