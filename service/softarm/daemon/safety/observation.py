"""Inputs of the health checks: one frozen snapshot of the service, made every tick."""

from dataclasses import dataclass

from softarm_client.modes import Mode

SETTLING_S = 5.0
"""So long after its start the service does not report what has not answered yet."""


def too_old(age_s: float | None, deadline_s: float) -> bool:
    """Return whether a last valid reading is missing or past its deadline."""
    return age_s is None or age_s > deadline_s


@dataclass(frozen=True)
class DeviceStatus:
    """A configured instrument other than the valve bank.

    Args:
        name: Its name in the configuration.
        connected: Whether its connection stands.
        gave_up: Whether the driver has ended for good: the configuration does not fit the device.
        error: Why the last attempt failed, empty when none did.
        cure: What to do about that.
        age_s: Age of its last valid reading; ``None`` before the first.
        deadline_s: Age from which it counts as silent.
        measured: Whether an input of the estimator or a gauge reads it: then that input reports its silence.
        sink_errors: Readings that the service failed to process.
    """

    name: str
    connected: bool
    gave_up: bool = False
    error: str = ""
    cure: str = ""
    age_s: float | None = None
    deadline_s: float = 0.5
    measured: bool = True
    sink_errors: int = 0

    @property
    def silent(self) -> bool:
        """Whether its last valid reading is too old."""
        return too_old(self.age_s, self.deadline_s)


@dataclass(frozen=True)
class Input:
    """One stream of measurements.

    Args:
        name: Device, or device and body.
        needed: Whether pressurised modes that follow the pose cannot do without it.
        age_s: Age of its last valid reading; ``None`` before the first.
        deadline_s: Age from which it counts as stale.
        trouble: What is wrong with its device, empty when nothing is.
    """

    name: str
    needed: bool
    age_s: float | None
    deadline_s: float
    trouble: str = ""

    @property
    def stale(self) -> bool:
        """Whether the last valid reading is too old."""
        return too_old(self.age_s, self.deadline_s)


@dataclass(frozen=True)
class Valves:
    """The valve bank.

    Args:
        name: Device name.
        age_s: Age of the last cycle that was read and checked; ``None`` before the first.
        deadline_s: Age from which the bank counts as lost.
        faults: What makes its outputs untrustworthy, in words.
        warnings: What a person should know of.
    """

    name: str
    age_s: float | None
    deadline_s: float
    faults: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def lost(self) -> bool:
        """Whether the bank no longer answers."""
        return too_old(self.age_s, self.deadline_s)


@dataclass(frozen=True)
class EstimatorHealth:
    """The estimator's process.

    Args:
        running: Whether the process lives and has been warmed up.
        starting: Whether it is being built for the first time.
        gave_up: Whether it died too often to be started again.
        age_s: Time since its last result, or since it was ready if that is later; ``None`` before it was.
        deadline_s: Age from which it counts as failed.
        failures: Results in a row that did not converge.
        rod_off_degrees: Angle by which the calibrated rod was off when last compared; ``None`` without one.
    """

    running: bool
    age_s: float | None
    deadline_s: float
    failures: int = 0
    rod_off_degrees: float | None = None
    starting: bool = False
    gave_up: bool = False


@dataclass(frozen=True)
class RecorderHealth:
    """The recorder.

    Args:
        active: Whether a file is open.
        dropped: Messages dropped since it was opened.
        error: Why writing failed, empty when it did not.
        free_bytes: Space left where it writes; ``None`` while that is not known.
    """

    active: bool
    dropped: int
    error: str
    free_bytes: int | None


@dataclass(frozen=True)
class ServiceHealth:
    """The service at one tick.

    Args:
        mode: The mode whose demands are checked.
        valves: The valve bank.
        inputs: The streams of measurements.
        estimator: The estimator's process.
        overruns: Ticks skipped within the last second.
        devices: The instruments.
        uptime_s: Time since the loop began to run.
        busy: How the processor keeps the service waiting, in words; empty when it does not.
    """

    mode: Mode
    valves: Valves
    inputs: tuple[Input, ...]
    estimator: EstimatorHealth
    recorder: RecorderHealth
    overruns: int
    devices: tuple[DeviceStatus, ...] = ()
    uptime_s: float = SETTLING_S
    busy: str = ""

    @property
    def settling(self) -> bool:
        """Whether the service has only just begun, or still builds its estimator on a busy machine."""
        # Compiling the estimator loads the processor for a minute; on a small host the drivers fall behind.
        building = self.mode is Mode.STARTING and bool(self.busy)
        return self.uptime_s < SETTLING_S or building
