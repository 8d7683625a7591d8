"""The health of an arm as ``DiagnosticArray``: findings, inputs, estimator and the test of the model."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from softarm_client.arm import STALE_S
from softarm_client.messages import Estimate, HealthFinding, Mismatch, State
from softarm_client.ros.interface import TOPICS
from softarm_client.ros.messages import FRESH_NS, SOLVED, Outgoing, Types, time_of

OK, WARN, ERROR, STALE = "OK", "WARN", "ERROR", "STALE"
RANK = OK, WARN, ERROR
LEVELS = {"info": OK, "warning": WARN, "fault": ERROR}
"""Level of each severity of a finding; one of a newer service counts as a warning."""


@dataclass(frozen=True)
class Status:
    """How one part of the arm is.

    Args:
        part: Its name.
        level: Name of a level of ``DiagnosticStatus``.
        message: How it is, in a sentence.
        values: Further facts.
    """

    part: str
    level: str
    message: str
    values: dict[str, object] = field(default_factory=dict)


class Diagnostics:
    """Reports the health of an arm; a part that was reported once is in every later report.

    Args:
        arm: The arm's name.
        types: Finds the classes of ROS 2.
        clock: Monotonic time [s].
    """

    def __init__(self, arm: str, types: Types, clock: Callable[[], float] = time.monotonic) -> None:
        self._arm = arm
        self._types = types
        self._clock = clock
        self._received_s = 0.0
        self._state: State | None = None
        self._estimate: Estimate | None = None
        self._mismatch: Mismatch | None = None
        self._parts: dict[str, None] = {}

    def note_state(self, state: State) -> None:
        """Note a state for the next report."""
        self._state, self._received_s = state, self._clock()

    def note_estimate(self, estimate: Estimate) -> None:
        """Note an estimate for the next report."""
        self._estimate = estimate

    def note_mismatch(self, mismatch: Mismatch) -> None:
        """Note a test of the model for the next report."""
        self._mismatch = mismatch

    def report(self) -> Outgoing:
        """Report every part; all of them as stale when the service is not heard."""
        state, age_s = self._state, self._clock() - self._received_s
        if state is None:
            return self._message(
                [Status("service", STALE, "nothing received from the service")], time.time_ns()
            )
        now_ns = state.stamp.unix_ns + round(age_s * 1e9)
        if age_s > STALE_S:
            what = f"nothing received from the service for {age_s:.1f} s"
            return self._message([Status(part, STALE, what) for part in self._parts or ("service",)], now_ns)
        by_part = {status.part: status for status in self._statuses(state)}
        self._parts |= dict.fromkeys(by_part)
        gone = (Status(part, OK, "no finding") for part in self._parts if part not in by_part)
        return self._message([*by_part.values(), *gone], now_ns)

    def _statuses(self, state: State) -> Iterator[Status]:
        yield _service(state)
        yield _estimator(state, self._estimate)
        yield _model(self._mismatch)
        findings: dict[str, list[HealthFinding]] = {name: [] for name in state.ages_s}
        for finding in state.findings:
            findings.setdefault(finding.where, []).append(finding)
        for where, held in findings.items():
            yield _part(where, held, state.ages_s)

    def _message(self, statuses: list[Status], unix_ns: int) -> Outgoing:
        kind = self._types("diagnostic_msgs/msg/DiagnosticStatus")
        pair = self._types("diagnostic_msgs/msg/KeyValue")
        header = self._types("std_msgs/msg/Header")(stamp=time_of(self._types, unix_ns), frame_id="")
        entries: list[Any] = [
            kind(
                level=getattr(kind, status.level),
                name=f"{self._arm}: {status.part}",
                message=status.message,
                hardware_id=self._arm,
                values=[pair(key=key, value=str(value)) for key, value in status.values.items()],
            )
            for status in statuses
        ]
        topic = TOPICS["diagnostics"]
        return Outgoing(topic.name, topic.type, self._types(topic.type)(header=header, status=entries))


def _service(state: State) -> Status:
    faulted = state.mode == "FAULTED"
    message = f"{state.mode}: {state.fault_cause}" if faulted else str(state.mode)
    values = {
        "source": state.stamp.source,
        "lease holder": state.lease.holder or "nobody",
        "recording": state.recording or "none",
        "ticks": state.ticks,
        "overruns": state.overruns,
    }
    return Status("service", ERROR if faulted else OK, message, values)


def _estimator(state: State, estimate: Estimate | None) -> Status:
    if estimate is None:
        return Status("estimate", STALE, "no estimate")
    age_ns = state.stamp.unix_ns - estimate.stamp.unix_ns
    if age_ns > FRESH_NS:
        return Status("estimate", STALE, f"no estimate for {age_ns * 1e-9:.1f} s")
    level = OK if estimate.status == "converged" else WARN if estimate.status in SOLVED else ERROR
    values: dict[str, object] = {
        "sensors used": ", ".join(estimate.sensors_used),
        "sensors lost": ", ".join(estimate.sensors_lost),
        "not observable": "; ".join(estimate.unobservable),
        "normalised residual": estimate.normalised_residual,
        "latency [s]": estimate.latency_s,
    }
    if estimate.contact is not None:
        values["contact height [m]"] = estimate.contact.height_m
        values["contact height std [m]"] = estimate.contact.height_std_m
    return Status("estimate", level, estimate.status, values)


def _model(mismatch: Mismatch | None) -> Status:
    if mismatch is None:
        return Status("model", STALE, "no test of the model")
    if mismatch.consistent:
        return Status("model", OK, "agrees with the measurements")
    where = ", ".join(mismatch.where)
    return Status("model", WARN, "differs from the measurements", {"where": where, "advice": mismatch.advice})


def _part(where: str, findings: list[HealthFinding], ages_s: dict[str, float | None]) -> Status:
    level = max((LEVELS.get(finding.severity, WARN) for finding in findings), key=RANK.index, default=OK)
    message = "; ".join(finding.message for finding in findings) or "no finding"
    values: dict[str, object] = {finding.code: finding.hint for finding in findings}
    if where in ages_s:
        age_s = ages_s[where]
        values["age of the last valid reading [s]"] = "never" if age_s is None else f"{age_s:.3f}"
    return Status(where, level, message, values)
