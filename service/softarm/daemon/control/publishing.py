"""Builds the messages of the streams."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from softarm.daemon.control.controller import Controller
from softarm.daemon.control.estimator_state import EstimatorState
from softarm.daemon.control.instruments import Source
from softarm.daemon.control.lateness import TickDrift
from softarm.daemon.control.mismatch import MismatchTest
from softarm.daemon.estimation.messages import EstimationResult
from softarm.daemon.safety.diagnostics import HealthMonitor
from softarm.estimator.arrays import Floats
from softarm_client.messages import (
    STREAMS,
    Estimate,
    Event,
    HealthFinding,
    LeaseState,
    Mismatch,
    SectionPose,
    Stamp,
    State,
)
from softarm_client.modes import Mode

Status = Literal["converged", "not_converged", "degraded", "no_data"]
Kind = Literal["mode", "contact_begin", "contact_end", "finding", "finding_cleared"]


@dataclass(frozen=True)
class StateInputs:
    """The parts of the state message besides mode, lease and estimate.

    Args:
        applied: Gauge pressures last written [Pa], shape (chambers,).
        measured: Gauge pressures measured [Pa], shape (chambers,); ``None`` when lost.
        gauges_n: Pull on each force gauge by its section [N]; ``None`` when lost.
        ages_s: Age of the last valid reading of every input [s].
        ticks: Control ticks since the start.
        overruns: Ticks skipped.
        drift: How late the ticks of the last seconds came; ``None`` before the first.
        recording: File being recorded, ``None`` when none.
    """

    applied: Floats
    measured: Floats | None
    gauges_n: Mapping[str, float | None]
    ages_s: Mapping[str, float | None]
    ticks: int
    overruns: int
    drift: TickDrift | None
    recording: str | None


class Publisher:
    """Makes messages; each stream counts its own.

    Args:
        specimen: Name or path of the specimen.
        source: Where the readings come from.
        controller: Mode, lease and set-points.
        estimator_state: The newest estimate.
        health: Diagnostics that stand.
    """

    def __init__(
        self,
        specimen: str,
        source: Source,
        controller: Controller,
        estimator_state: EstimatorState,
        health: HealthMonitor,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        unix_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self._specimen = specimen
        self._source = source
        self._controller = controller
        self._estimator_state = estimator_state
        self._health = health
        self._clock_ns = clock_ns
        self._unix_ns = unix_ns
        self._counts = dict.fromkeys(STREAMS, 0)

    def _stamp(self, stream: str) -> Stamp:
        self._counts[stream] += 1  # a gap in it shows a client how many messages it lost
        return Stamp(
            sequence=self._counts[stream],
            monotonic_ns=self._clock_ns(),
            unix_ns=self._unix_ns(),
            source=self._source,
        )

    def state(self, inputs: StateInputs) -> State:
        """Build the state of the arm."""
        controller, answer = self._controller, self._estimator_state.hold_answer
        now_ns = self._clock_ns()
        hold = answer if controller.modes.mode in (Mode.TEACH, Mode.HOLDING) else None
        return State(
            stamp=self._stamp("state"),
            mode=controller.modes.mode,
            fault_cause=controller.modes.fault_cause,
            findings=tuple(self._findings()),
            asked_pa=tuple(controller.setpoint.tolist()),
            applied_pa=tuple(inputs.applied.tolist()),
            measured_pa=self._measured(inputs.measured),
            sections=self._estimator_state.sections,
            gauges_n=dict(inputs.gauges_n),
            ages_s=dict(inputs.ages_s),
            lease=LeaseState(
                holder=controller.lease.holder(now_ns), remaining_s=controller.lease.remaining_s(now_ns)
            ),
            ticks=inputs.ticks,
            overruns=inputs.overruns,
            drift_median_s=None if inputs.drift is None else inputs.drift.median_s,
            drift_p99_s=None if inputs.drift is None else inputs.drift.p99_s,
            recording=inputs.recording,
            teach_pressures_pa=tuple(hold.pressures.tolist()) if hold and hold.valid else None,
            teach_reachable=hold.reachable if hold else None,
            teach_note=hold.note if hold else None,
        )

    def _measured(self, measured: Floats | None) -> tuple[float | None, ...]:
        lost = (None,) * len(self._controller.setpoint)
        return lost if measured is None else tuple(float(pressure) for pressure in measured)

    def _findings(self) -> list[HealthFinding]:
        return [
            HealthFinding(
                code=standing.finding.code,
                where=standing.finding.where,
                severity=standing.finding.severity,
                message=standing.finding.message,
                hint=standing.finding.hint,
                since_unix_ns=standing.since_unix_ns,
            )
            for standing in self._health.active
        ]

    @property
    def sections(self) -> tuple[SectionPose, ...]:
        """Poses of the sections of the newest estimate."""
        return self._estimator_state.sections

    def estimate(self, result: EstimationResult) -> Estimate:
        """Build the message with the external force."""
        net, request = result.loads - self._estimator_state.tare, result.request
        dof = result.degrees_of_freedom
        ratio = float(np.sqrt(result.innovation_squared / dof)) if dof > 0.1 else None
        solved: Status = "degraded" if request.lost else "converged"
        loads = self._estimator_state.load_map.forces(net, result.load_covariance)
        stamp = self._stamp("estimate")  # after the slow parts, so that its time is that of sending
        return Estimate(
            stamp=stamp,
            status=solved if result.converged else "not_converged",
            model=result.model,
            loads=loads,
            contact=self._estimator_state.contact,
            in_contact=self._estimator_state.contact_since_unix_ns is not None,
            tare_n=self._estimator_state.load_map.vectors(self._estimator_state.tare),
            normalised_residual=ratio,
            degrees_of_freedom=round(dof),
            unobservable=(*result.unobservable, *self._estimator_state.load_map.not_estimated),
            sensors_used=request.used,
            sensors_lost=request.lost,
            latency_s=(stamp.monotonic_ns - request.newest_arrival_ns) * 1e-9,
            solve_s=result.solve_s,
        )

    def mismatch(self, test: MismatchTest, recording: str | None) -> Mismatch:
        """Return whether model and measurements agree."""
        return Mismatch(
            stamp=self._stamp("mismatch"),
            consistent=test.consistent,
            since_unix_ns=test.since_unix_ns,
            where=test.suspects,
            normalised_innovation_squared=test.ratio,
            recording=recording,
            advice="nothing to do" if test.consistent else self._advice(recording),
        )

    def _advice(self, recording: str | None) -> str:
        diagnose = f"softarm diagnose {recording or 'RECORDING'} --specimen {self._specimen}"
        if recording is None:
            return f"record the mismatch with record/start and record/stop, then run: {diagnose}"
        return f"end the recording with record/stop, then run: {diagnose}"

    def occurrence(self, kind: Kind, where: str, text: str, by: str) -> Event:
        """Build the message of an event and its client."""
        return Event(stamp=self._stamp("event"), kind=kind, where=where, text=text, by=by)
