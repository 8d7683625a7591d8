"""What happens at every tick to keep the arm safe: set-points renewed, health judged, faults acted upon."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from softarm.daemon.control.controller import Controller
from softarm.daemon.control.estimator_state import EstimatorState
from softarm.daemon.control.instruments import Instruments
from softarm.daemon.control.lateness import SkippedTicks
from softarm.daemon.control.readings import Readings
from softarm.daemon.safety.diagnostics import Diagnostic, HealthMonitor
from softarm.daemon.safety.modes import PRESSURISED, Mode, Transition, Trigger
from softarm.daemon.safety.observation import EstimatorHealth, RecorderHealth, ServiceHealth, Valves
from softarm.drivers.errors import DeviceError


@dataclass(frozen=True)
class SafetyInputs:
    """Inputs of the safety monitor.

    Args:
        instruments: Where readings come from and set-points go.
        readings: The newest sample of every channel.
        controller: Mode, lease and set-points.
        estimator_state: The newest estimate.
        health: Keeps the diagnostics.
        estimator: Returns the state of the estimator process at a monotonic time.
        recorder: Returns the state of the recorder.
        valve_deadline_s: A valve bank that does not answer for so long is lost.
        report: Called with a diagnostic and whether it is new (or has cleared itself).
        busy: Describes how the processor keeps the service waiting, empty when it does not.
    """

    instruments: Instruments
    readings: Readings
    controller: Controller
    estimator_state: EstimatorState
    health: HealthMonitor
    estimator: Callable[[int], EstimatorHealth]
    recorder: Callable[[], RecorderHealth]
    valve_deadline_s: float
    report: Callable[[Diagnostic, bool], None]
    busy: Callable[[int], str] = lambda _: ""


class SafetyMonitor:
    """Advances the controller and ends a pressurised mode as soon as something forbids it.

    Args:
        inputs: What it checks.
    """

    def __init__(self, inputs: SafetyInputs) -> None:
        self._inputs = inputs
        self._skipped = SkippedTicks()
        self._began_ns: int | None = None
        self._expiries = 0

    def overran(self, missed: int, now_ns: int) -> None:
        """Count ticks that were skipped just before a monotonic time."""
        self._skipped.add(now_ns, missed)

    @property
    def overruns(self) -> int:
        """Ticks skipped since the start."""
        return self._skipped.total

    def advance(self, now_ns: int, elapsed_s: float) -> Transition | None:
        """Renew the set-point; valves that accept none end the mode.

        Args:
            now_ns: Monotonic time.
            elapsed_s: Time since the last tick [s].

        Returns:
            The change of mode, if there was one.
        """
        controller = self._inputs.controller
        if self._ran_out():
            cause = "a set-point expired before it was renewed, and the chambers vented"
            return controller.fire(Trigger.FAULT, self._of_the_bank(cause, now_ns))
        try:
            return controller.tick(now_ns, elapsed_s, self._inputs.estimator_state.hold)
        except DeviceError as error:  # the bank has disarmed itself since the last check
            return controller.fire(Trigger.FAULT, f"{error.device}: {error.what}")

    def _ran_out(self) -> bool:
        """Return whether a pose that is taught or held lost its pressures since the last tick.

        In ARMED and EXPERIMENT the client's next set-point fills the chambers again from zero, at the rate
        of the slew limit; nothing would lead a pose back there.
        """
        before, self._expiries = self._expiries, self._inputs.instruments.expiries
        controller = self._inputs.controller
        following = controller.modes.mode in (Mode.TEACH, Mode.HOLDING) and controller.commanding
        return following and self._expiries > before

    def check(self, now_ns: int, unix_ns: int) -> Transition | None:
        """Judge the health of everything; a fault vents.

        Args:
            now_ns: Monotonic time.
            unix_ns: Wall clock.

        Returns:
            The change of mode, if there was one.
        """
        if self._inputs.instruments.source == "replay":
            return None  # stored readings raise no live alarm
        controller = self._inputs.controller
        new, cleared = self._inputs.health.update(
            self.observe(now_ns, controller.modes.mode), now_ns, unix_ns
        )
        for finding in (*new, *cleared):
            self._inputs.report(finding, finding in new)
        if controller.modes.mode not in PRESSURISED:
            return None
        # Not the standing findings: one that has gone a moment ago is still shown, but must not vent the arm.
        cause = self._cause(now_ns)
        return None if cause is None else controller.fire(Trigger.FAULT, cause)

    def _cause(self, now_ns: int) -> str | None:
        """Return the faults that forbid pressure in the chambers."""
        for finding in self._inputs.health.present_faults:
            return f"{finding.where}: {finding.message}"
        if not self._inputs.instruments.valves.armed:
            return self._of_the_bank("the valve bank has vented by itself", now_ns)
        return None

    def _of_the_bank(self, cause: str, now_ns: int) -> str:
        """Name the valve bank in a cause, and the processor where that may be to blame."""
        busy = self._inputs.busy(now_ns)
        return f"{self._inputs.instruments.bank}: {cause}" + (f", while {busy}" if busy else "")

    def blocking(self, mode: Mode, now_ns: int) -> tuple[Diagnostic, ...]:
        """List what keeps the service out of a mode."""
        return self._inputs.health.faults(self.observe(now_ns, mode))

    def observe(self, now_ns: int, mode: Mode) -> ServiceHealth:
        """Return a snapshot of the service for the health checks.

        Args:
            now_ns: Monotonic time.
            mode: The mode whose demands are to be checked.
        """
        inputs = self._inputs
        instruments, readings = inputs.instruments, inputs.readings
        if self._began_ns is None:
            self._began_ns = now_ns
        fatal, others = instruments.valve_alarms()
        return ServiceHealth(
            mode=mode,
            valves=Valves(
                instruments.bank,
                inputs.readings.age_s(instruments.bank, now_ns),
                inputs.valve_deadline_s,
                fatal,
                others,
            ),
            inputs=inputs.readings.inputs(now_ns, instruments.troubles()),
            estimator=inputs.estimator(now_ns),
            recorder=inputs.recorder(),
            overruns=self._skipped.recent(now_ns),
            devices=tuple(
                replace(device, age_s=readings.device_age_s(device.name, now_ns))
                for device in instruments.devices()
            ),
            uptime_s=(now_ns - self._began_ns) * 1e-9,
            busy=inputs.busy(now_ns),
        )
