"""When an estimate is started, and what its result changes."""

import numpy as np
from numpy.typing import NDArray

from softarm.daemon.config import Setup
from softarm.daemon.control.controller import Controller
from softarm.daemon.control.dependencies import LoopDependencies
from softarm.daemon.control.estimator_state import EstimatorState
from softarm.daemon.control.instruments import Instruments
from softarm.daemon.control.mismatch import MismatchTest
from softarm.daemon.control.readings import Readings
from softarm.daemon.control.reporting import Reporter
from softarm.daemon.estimation.messages import EstimationRequest, EstimationResult
from softarm.daemon.safety.modes import Mode
from softarm.daemon.safety.observation import EstimatorHealth

SHAPE_RATE_HZ = 10.0
OWN_TICK, NO_PACKET = 0.5, 1.5
"""Ticks after an estimate was requested from which a packet starts the next one, and from which a tick does
where no packet has: packets that jitter at the rate of the loop each start one, faster ones not all."""
OLD = 1.0 / 3.0
"""Age of a packet, in intervals between packets T, from which it is better to wait for the next one.

Where estimates take S and start at age a, the newest estimate is on average a + S + L/2 old, with L from one
start to the next. To wait makes a zero and L longer by T - a, which is less if a > T/3 (Y. Sun et al.,
Update or Wait, IEEE Trans. Inf. Theory 63 (2017) 7492).
"""
CONTACT_EVERY_NS = 2_000_000_000
"""Time between two requests to locate a contact, which costs the estimator a few more solves."""


class Estimates:
    """Starts estimates from the newest readings and handles their results.

    Args:
        setup: Rate, deadlines and gravity.
        dependencies: Builds the estimator's process; clocks.
        readings: The newest sample of every channel.
        instruments: Name of the valve bank.
        controller: Mode and hold.
        estimator_state: Keeps the newest result.
        reporter: Publishes and records.
    """

    def __init__(
        self,
        setup: Setup,
        dependencies: LoopDependencies,
        readings: Readings,
        instruments: Instruments,
        controller: Controller,
        estimator_state: EstimatorState,
        reporter: Reporter,
    ) -> None:
        self.process = dependencies.estimator(self.on_result)
        self.test = MismatchTest()
        self._readings = readings
        self._instruments = instruments
        self._controller = controller
        self._estimator_state = estimator_state
        self._reporter = reporter
        self._clocks = dependencies.clocks
        self._tick_ns = 1e9 / setup.config.control.rate_hz
        self._deadline_s = setup.config.safety.estimator_deadline_s
        self._chambers = len(setup.specimen.chambers)
        self._gravity = np.array(setup.specimen.gravity_m_s2)
        self._requested_ns = self._placed_ns = self._drawn_ns = 0
        self._packet_ns = self._interval_ns = 0
        self._last_result_ns: int | None = None
        self._ready_ns: int | None = None

    def on_packet(self, now_ns: int) -> None:
        """Start an estimate: a packet of the leading device is complete.

        Args:
            now_ns: Monotonic time.
        """
        self._interval_ns, self._packet_ns = now_ns - self._packet_ns, now_ns
        self._submit(now_ns, OWN_TICK)

    def on_tick(self, now_ns: int) -> None:
        """Start an estimate if packets have not: when they stop, or come more slowly than the ticks.

        Args:
            now_ns: Monotonic time.
        """
        self._submit(now_ns, NO_PACKET)

    def _submit(self, now_ns: int, after_ticks: float) -> None:
        if now_ns - self._requested_ns >= after_ticks * self._tick_ns:
            self.process.submit(self._request)  # made when the process is free, from the readings by then

    def _request(self) -> EstimationRequest | None:
        """Request an estimate of the newest readings, when the process is free for it."""
        now_ns = self._clocks.monotonic_ns()
        if self._better_to_wait(now_ns):
            return None
        snapshot = self._readings.snapshot(now_ns)
        if not snapshot.used:
            return None
        self._requested_ns = now_ns
        controller = self._controller
        return EstimationRequest(
            snapshot.time_s,
            snapshot.newest_arrival_ns,
            snapshot.readings,
            self._pressures(now_ns),
            self._gravity,
            snapshot.used,
            snapshot.lost,
            with_hold=controller.modes.mode in (Mode.TEACH, Mode.HOLDING),
            target=None if controller.hold is None else controller.hold.goal.target,
            with_contact=self._contact_due(now_ns),
            tare=self._estimator_state.tare,
            with_mesh=self._shape_due(now_ns),
        )

    def _better_to_wait(self, now_ns: int) -> bool:
        """Return whether the last packet is so old that the next one, due soon, is worth the wait."""
        each_tick = self._interval_ns < NO_PACKET * self._tick_ns
        return (
            each_tick and OLD * self._interval_ns < now_ns - self._packet_ns < NO_PACKET * self._interval_ns
        )

    def _pressures(self, now_ns: int) -> NDArray[np.float64]:
        """Return the measured pressures [Pa], NaN when they are stale, shape (chambers,).

        The estimator leaves NaN out of its measurements; stale values would look like a force.
        """
        valves = self._readings.fresh(self._instruments.bank, now_ns)
        return np.full(self._chambers, np.nan) if valves is None else np.array(valves.value)

    def _contact_due(self, now_ns: int) -> bool:
        rested = now_ns - self._placed_ns > CONTACT_EVERY_NS
        return self._estimator_state.contact_since_unix_ns is not None and rested

    def _shape_due(self, now_ns: int) -> bool:
        due = (now_ns - self._drawn_ns) * 1e-9 * SHAPE_RATE_HZ >= 1.0 and self._reporter.shape_wanted
        if due:
            self._drawn_ns = now_ns
        return due

    def on_result(self, result: EstimationResult) -> None:
        """Handle a result of the estimator: publish it, follow contacts and the test of the model."""
        # Measured from now, not from the readings: this is about the process, not about the sensors.
        self._last_result_ns = self._clocks.monotonic_ns()
        if not result.finite:
            self._estimator_state.fail()
            return
        unix_ns = self._clocks.unix_ns()
        before = self._estimator_state.contact_since_unix_ns
        self._estimator_state.update(result, unix_ns)
        self._reporter.estimate(result)
        since = self._estimator_state.contact_since_unix_ns
        if (before is None) is not (since is None):
            self._reporter.contact(began=since is not None)
        if result.request.with_contact:
            self._placed_ns = self._last_result_ns
        # The innovations of a search that stopped early do not test the model.
        if result.converged:
            self.test = self.test.update(
                result.request.time_s,
                result.innovation_squared,
                result.degrees_of_freedom,
                result.sensor_innovations,
                unix_ns,
            )

    def observe(self, now_ns: int) -> EstimatorHealth:
        """Return the state of the estimator for the health checks."""
        result = self._estimator_state.result
        off = None if result is None or result.rod_off_rad is None else float(np.degrees(result.rod_off_rad))
        state = self.process.state
        return EstimatorHealth(
            state.running,
            self._age_s(now_ns, state.running),
            self._deadline_s,
            self._estimator_state.failures,
            off,
            state.starting,
            state.gave_up,
        )

    def _age_s(self, now_ns: int, running: bool) -> float | None:
        """Return how long the process has been silent [s]: since its last result, or since it was ready."""
        if not running:
            self._ready_ns = None
        elif self._ready_ns is None:
            self._ready_ns = now_ns
        last_ns = max(filter(None, (self._last_result_ns, self._ready_ns)), default=None)
        return None if last_ns is None else max(now_ns - last_ns, 0) * 1e-9
