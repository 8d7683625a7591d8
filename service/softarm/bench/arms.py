"""``softarm bench arms``: what each of several arms on one machine costs."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np

from softarm.bench.latency import LIMITS_MS, SETTLE_S, Measured, armed_rig, drive, listen, seconds_option
from softarm.cli.output import json_option, progress, quick_option, show
from softarm.common.errors import WorkFailedError
from softarm.common.tables import Cell, Table
from softarm.experiments.rig import PATIENCE, FakeRig
from softarm_client import Arm

COUNTS = (1, 2, 4)
RATE_HZ = 100.0
CLOCK_TICKS = os.sysconf("SC_CLK_TCK")
PARTS = ("loop", "network", "estimator", "fakes")
"""The thread of the control loop; other threads of its process, zenoh's above all; the other processes."""


@dataclass(frozen=True)
class ArmCost:
    """What one arm cost while it was measured.

    Args:
        measured: Latencies, replies and ticks.
        spent_s: Processor time of each of ``PARTS`` [s].
    """

    measured: Measured
    spent_s: dict[str, float]


@click.command()
@seconds_option
@click.option(
    "--model",
    type=click.Choice(list(LIMITS_MS)),
    default="rod",
    show_default=True,
    help="What the estimators run on.",
)
@quick_option
@json_option
def command(seconds: float, model: str, quick: bool, as_json: bool) -> int:
    """Run 1, 2 and 4 fake arms on this machine and measure what each costs.

    Each arm has a service and fakes of its own, at 100 Hz, and moves all the while. Where the machine is
    too small for them, the outcome says what failed first. Real arms leave the fakes' share free.

    Example: softarm bench arms --seconds 20
    """
    counts = COUNTS[:2] if quick else COUNTS
    with progress("arms", len(counts)) as advance:
        rows = [_row(count, model, 3.0 if quick else seconds, advance) for count in counts]
    notes = (
        "Per arm: medians and percentiles over the estimates of all arms, processor time over their number.",
        f"The machine has {os.cpu_count()} cores; cores: processor time per second. Real-time: loop, fakes.",
        "slowest_reply: the longest that a command of any arm waited for its answer.",
    )
    show(Table("Several arms on one machine", rows, notes), as_json=as_json)
    return 0


def _row(count: int, model: str, seconds: float, advance: Callable[[float], None]) -> dict[str, Cell]:
    """Measure a number of arms at once, each no less patient than an experiment on fakes."""
    try:
        with ExitStack() as stack:
            arms = [stack.enter_context(armed_rig(model, RATE_HZ, PATIENCE)) for _ in range(count)]
            with ThreadPoolExecutor(count) as threads:
                costs = list(threads.map(lambda arm: cost_of(arm[0], arm[1], seconds), arms))
    except WorkFailedError as error:
        return {"arms": count, "outcome": str(error)}
    finally:
        advance(1)
    latencies = np.concatenate([one.measured.latencies_ms for one in costs])
    duration = sum(one.measured.duration_s for one in costs)
    return {
        "arms": count,
        "estimates_per_s": len(latencies) / duration,
        "median_ms": float(np.median(latencies)),
        "p99_ms": float(np.quantile(latencies, 0.99)),
        "slowest_reply_ms": max(float(one.measured.replies_ms.max()) for one in costs),
        **{f"{part}_cores": sum(one.spent_s[part] for one in costs) / duration for part in PARTS},
        "late_ticks_percent": 100.0
        * sum(one.measured.late for one in costs)
        / sum(one.measured.ticks + one.measured.late for one in costs),
        "outcome": "all moved",
    }


def cost_of(rig: FakeRig, client: Arm, seconds: float) -> ArmCost:
    """Move an arm and measure what it costs."""
    drive(client, SETTLE_S)
    before = spent(rig)
    measured = listen(client, seconds)
    return ArmCost(measured, {part: after - before[part] for part, after in spent(rig).items()})


def spent(rig: FakeRig) -> dict[str, float]:
    """Return the processor time of each of ``PARTS`` so far [s]."""
    service = rig.service.process.pid
    loop, process = (task_time(Path(f"/proc/{service}{task}")) for task in (f"/task/{service}", ""))
    estimator = processor_time(service) - process
    return dict(
        zip(PARTS, (loop, process - loop, estimator, processor_time(rig.fakes.process.pid)), strict=True)
    )


def processor_time(root: int) -> float:
    """Return the processor time of a process and its descendants so far [s]."""
    return sum(task_time(Path(f"/proc/{pid}")) for pid in family(root))


def task_time(task: Path) -> float:
    """Return the processor time of a process or thread so far [s], from its folder; see proc(5)."""
    # After the command's name, which may hold spaces, utime and stime are the 12th and 13th field.
    fields = (task / "stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / CLOCK_TICKS


def family(root: int) -> Iterator[int]:
    """Yield a process and its descendants."""
    yield root
    for listing in Path(f"/proc/{root}/task").glob("*/children"):
        for child in listing.read_text().split():
            yield from family(int(child))
