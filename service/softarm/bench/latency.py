"""``softarm bench latency``: from a motion-capture packet to the estimate in another process."""

import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np

from softarm.cli.output import NumberRange, json_option, progress, quick_option, show
from softarm.common.errors import WorkFailedError
from softarm.common.rods import trusted_rod
from softarm.common.shipped import fake_specimen
from softarm.common.tables import Cell, Table
from softarm.estimator.arrays import Floats
from softarm.estimator.specimen import load_specimen
from softarm.experiments.rig import UNIT_NICENESS, FakeRig, RigSettings, free_endpoint, niceness
from softarm.experiments.session import connect, wait_ready
from softarm_client import Arm
from softarm_client.errors import CommandRefusedError
from softarm_client.messages import Estimate

LIMITS_MS = {"fem": 12.0, "rod": 2.0}
STAGES = ("solve", "service", "network")
"""The estimator; the rest of the service, with the way to the estimator and back; that to the subscriber."""
SCENARIO = """\
name = "latency"
seed = 1
control_port = 0

[plant]
kind = "arm"

[[device]]
name = "valves"
kind = "festo_mpa"
valve_map = [3, 2, 1, 0, 4, 5]

[[device]]
name = "qtm"
kind = "qualisys"
rate_hz = {rate:.1f}
"""
SETTLE_S = 3.0
COMMANDS_HZ = 20.0
AMPLITUDE_PA = 15e3
PERIOD_S = 4.0


@dataclass(frozen=True)
class LatencyCase:
    """One row of the table.

    Args:
        model: What the estimator runs on.
        rate_hz: Rate of cameras and control loop.
        busy: Whether another process computes all the while.
    """

    model: str
    rate_hz: float
    busy: bool


@dataclass(frozen=True)
class Measured:
    """What was measured.

    Args:
        latencies_ms: Of each estimate, shape (estimates,).
        stages_ms: The part of it that each of ``STAGES`` took, shape (estimates, stages).
        replies_ms: How long each command waited for its answer, shape (commands,).
        converged: Share of the estimates that converged.
        ticks: Ticks of the control loop.
        late: Ticks skipped.
        duration_s: How long it was measured.
    """

    latencies_ms: Floats
    stages_ms: Floats
    replies_ms: Floats
    converged: float
    ticks: int
    late: int
    duration_s: float


CASES = tuple(
    LatencyCase(model, rate, busy)
    for model, rate in (("fem", 100.0), ("rod", 100.0), ("rod", 1000.0))
    for busy in (False, True)
)


seconds_option = click.option(
    "--seconds",
    type=NumberRange(min=1.0),
    default=12.0,
    show_default=True,
    help="Duration of each measurement.",
)


@click.command()
@seconds_option
@click.option("--model", type=click.Choice(list(LIMITS_MS)), help="Measure only this model.")
@quick_option
@json_option
def command(seconds: float, model: str | None, quick: bool, as_json: bool) -> int:
    """Time estimates from the packet to a subscriber in another process, on the fakes.

    The latency is the time from the arrival of a packet's last byte at the service to the decoded estimate at
    a zenoh subscriber in this process, while the arm moves. The benchmark measures the converged finite
    elements at 100 Hz, and the calibrated rod at 100 Hz and 1 kHz; then each again beside a process that
    computes. The exit status is 1 if a median without that process exceeds 12 ms (finite elements) or 2 ms
    (rod), or if the rod is too far from the finite elements for the service to run on it.

    Example: softarm bench latency
    """
    cases = [case for case in CASES if model in (None, case.model) and not (quick and case.busy)]
    refused = _refusal() if any(case.model == "rod" for case in cases) else None
    tried = [case for case in cases if refused is None or case.model != "rod"]
    rows: list[dict[str, Cell]] = []
    stages: list[dict[str, Cell]] = []
    with progress("latency", len(tried)) as advance:
        for case in tried:
            measured = measure(case, 4.0 if quick else seconds)
            rows.append(row_of(case, measured))
            stages += stage_rows(case, measured)
            advance(1)
    notes = (
        "The fakes, the arm's simulation, the service, its estimator and this subscriber share the machine; "
        "the subscriber has the niceness of the service.",
        "late_ticks: ticks of the control loop that were skipped.",
        *([] if refused is None else [f"Not measured with the rod: {refused}."]),
    )
    parts = (
        "solve: the estimator alone; service: the rest up to the message; network: from there on.",
        "among_slowest: what it takes of the hundredth of the estimates that take longest, mean.",
    )
    show(
        Table("From the packet to the subscriber", rows, notes),
        Table("Stages of the way", stages, parts),
        as_json=as_json,
    )
    return 0 if refused is None and all(row["passes"] is not False for row in rows) else 1


def _refusal() -> str | None:
    """Return why the service would not run on the rod of the rig's specimen; None when it would."""
    try:
        with progress("rod") as advance:
            trusted_rod(load_specimen(fake_specimen()), lambda *_: advance(1))
    except WorkFailedError as error:
        return str(error)
    return None


def stage_rows(case: LatencyCase, measured: Measured) -> list[dict[str, Cell]]:
    """Write what each stage takes, usually and where an estimate takes long."""
    if not len(measured.latencies_ms):
        return []
    slowest = measured.latencies_ms >= np.quantile(measured.latencies_ms, 0.99)
    return [
        {
            "model": case.model,
            "rate_hz": case.rate_hz,
            "machine": machine_of(case),
            "stage": stage,
            "median_ms": float(np.median(taken)),
            "p99_ms": float(np.quantile(taken, 0.99)),
            "among_slowest_ms": float(taken[slowest].mean()),
        }
        for stage, taken in zip(STAGES, measured.stages_ms.T, strict=True)
    ]


def machine_of(case: LatencyCase) -> str:
    """Describe what else the machine does."""
    return "one process computes" if case.busy else "idle but for the rig"


def row_of(case: LatencyCase, measured: Measured) -> dict[str, Cell]:
    """Write a measurement as a row; a busy machine has no limit."""
    median = float(np.median(measured.latencies_ms)) if len(measured.latencies_ms) else math.nan
    limit = None if case.busy else LIMITS_MS[case.model]
    return {
        "model": case.model,
        "rate_hz": case.rate_hz,
        "machine": machine_of(case),
        "estimates_per_s": len(measured.latencies_ms) / measured.duration_s,
        "median_ms": median,
        "p99_ms": float(np.quantile(measured.latencies_ms, 0.99)) if len(measured.latencies_ms) else math.nan,
        "converged_percent": 100.0 * measured.converged,
        "ticks": measured.ticks,
        "late_ticks": measured.late,
        "limit_ms": limit,
        "passes": None if limit is None else bool(median <= limit),
    }


def measure(case: LatencyCase, seconds: float) -> Measured:
    """Start a rig and a service and listen to its estimates."""
    with ExitStack() as stack:
        _, client = stack.enter_context(armed_rig(case.model, case.rate_hz))
        if case.busy:
            stack.enter_context(computing())
        drive(client, SETTLE_S)
        return listen(client, seconds)


@contextmanager
def armed_rig(model: str, rate_hz: float, patience: float = 1.0) -> Iterator[tuple[FakeRig, Arm]]:
    """Start fakes and a service on them, and arm it.

    Args:
        model: What the estimator runs on.
        rate_hz: Rate of cameras and control loop.
        patience: Factor on how long everything may be silent.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="softarm-latency-")))
        scenario = folder / "scenario.toml"
        scenario.write_text(SCENARIO.format(rate=rate_hz))
        settings = RigSettings(
            scenario,
            specimen=str(fake_specimen()),
            endpoint=free_endpoint(),
            model=model,
            rate_hz=rate_hz,
            sensors=("orientation",),
            forces_on=("tip",),
            patience=patience,
        )
        rig = stack.enter_context(FakeRig(settings, folder / "rig"))
        # A client on a host of its own would not wait for the service's processes at all.
        stack.enter_context(niceness(UNIT_NICENESS))
        client = stack.enter_context(connect(rig))
        wait_ready(client)
        stack.enter_context(client.lease())
        client.arm()
        yield rig, client


def listen(client: Arm, seconds: float) -> Measured:
    """Move the arm and note when each estimate comes."""
    stages: list[tuple[float, float, float]] = []
    converged: list[bool] = []

    def on_estimate(estimate: Estimate) -> None:
        network_s = (time.monotonic_ns() - estimate.stamp.monotonic_ns) * 1e-9
        stages.append((estimate.solve_s, estimate.latency_s - estimate.solve_s, network_s))
        converged.append(estimate.status in ("converged", "degraded"))

    before, begin = client.state(), time.monotonic()
    with client.estimates().subscribe(on_estimate):
        replies_s = drive(client, seconds)
    after = client.state()
    # The first message of a subscription is one from before it.
    stages_ms = 1e3 * np.array(stages[1:]).reshape(-1, len(STAGES))
    return Measured(
        stages_ms.sum(axis=1),
        stages_ms,
        1e3 * np.array(replies_s),
        float(np.mean(converged)) if converged else 0.0,
        after.ticks - before.ticks,
        after.overruns - before.overruns,
        time.monotonic() - begin,
    )


def drive(client: Arm, seconds: float) -> list[float]:
    """Move the arm along slow sines; return how long each command waited for its answer [s].

    Raises:
        WorkFailedError: The service vented the arm.
    """
    begin, replies_s = time.monotonic(), []
    while (now := time.monotonic() - begin) < seconds:
        phases = [2.0 * math.pi * now / PERIOD_S + k * math.pi / 3.0 for k in range(6)]
        pressures = [AMPLITUDE_PA * (1.0 + math.sin(phase)) / 2.0 for phase in phases]
        sent = time.monotonic()
        try:
            client.pressures.set(tuple(pressures), lifetime_s=1.0)
        except CommandRefusedError as error:
            cause = client.state().fault_cause or str(error)
            raise WorkFailedError(f"the arm stopped moving: {cause}") from error
        replies_s.append(time.monotonic() - sent)
        time.sleep(1.0 / COMMANDS_HZ)
    return replies_s


@contextmanager
def computing() -> Iterator[None]:
    """Keep one core busy for the length of a block."""
    with niceness(0):
        process = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        process.kill()
        process.wait()
