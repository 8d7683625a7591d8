"""``softarm bench safety``: every fault of every device in every mode, and where it leaves the arm."""

from collections.abc import Iterable, Sequence
from concurrent.futures import as_completed

import click

from acceptance import safety_run
from acceptance.safety_cases import FAST_S, Expectation
from acceptance.safety_processes import EVENT_NOTES, strike_processes
from acceptance.safety_run import BENCHES, KINDS, MODES, Case, everything, parts, run
from softarm.analysis.diagnosis.workers import workers
from softarm.cli.output import json_option, progress, quick_option, show
from softarm.common.tables import Cell, Table
from softarm_client.modes import Mode

NOTES = (
    "Real fakes, drivers, control loop and estimator in one process and accelerated time, in the modes in "
    "which the chambers hold pressure. Vented: the terminal holds zeros for every valve.",
    f"Aim: within {FAST_S:g} s of the fault; a pressure that is not reached counts after 1.7 s. "
    "No fault arms the arm again, and every device works again afterwards.",
    "A slot of festo_vtem keeps an error until the operator's clear acknowledges it.",
)


@click.command()
@click.option("--jobs", "-j", type=click.IntRange(1), default=2, show_default=True, help="Processes.")
@click.option("--mode", type=click.Choice([str(mode) for mode in MODES]), help="Only in this mode.")
@click.option("--kind", type=click.Choice(KINDS), help="Only devices of this kind.")
@click.option("--processes/--no-processes", default=True, help="Whether to kill and stall processes as well.")
@json_option
@quick_option
def command(
    jobs: int, mode: str | None, kind: str | None, processes: bool, as_json: bool, quick: bool
) -> int:
    """Inject each fault of every device in every mode; show where that left the arm.

    The benchmark then kills, freezes and stalls the processes of a running rig, and fills its disk. The exit
    status is 1 if the arm was left in another state than stated, or too late.

    Example: softarm bench safety --quick
    """
    modes = MODES if mode is None else (Mode(mode),)
    todo = parts(BENCHES[:1] if quick else BENCHES, modes, KINDS if kind is None else (kind,))
    cases: list[Case] = []
    with progress("faults", len(todo)) as advance, workers(jobs) as pool:
        for done in as_completed(
            pool.submit(run, part, safety_run.quick if quick else everything) for part in todo
        ):
            cases += done.result()
            advance(1)
    wrong = [case for case in cases if not case.right]
    tables = [Table("Faults of every device in every mode", summary(cases), NOTES)]
    if wrong:
        tables.append(Table("Not as stated", [detail(case) for case in wrong]))
    events = strike_processes() if processes else []
    if events:
        tables.append(Table("Processes of a running rig", [event.row() for event in events], EVENT_NOTES))
    show(*tables, as_json=as_json)
    return 1 if wrong or not all(event.right for event in events) else 0


def summary(cases: Sequence[Case]) -> list[dict[str, Cell]]:
    """Sum up the cases of each kind of device in each mode, and all of them."""
    keys = sorted({(case.kind, case.mode) for case in cases}, key=lambda key: (key[0], MODES.index(key[1])))
    rows = [_row(kind, mode, [c for c in cases if (c.kind, c.mode) == (kind, mode)]) for kind, mode in keys]
    return [*rows, _row("all", "all", cases)]


def _row(kind: str, mode: str, cases: Iterable[Case]) -> dict[str, Cell]:
    listed = list(cases)
    vents = [case for case in listed if case.outcome is Expectation.VENTS]
    fast = [case.vented_s for case in vents if case.within_s == FAST_S and case.vented_s is not None]
    return {
        "device": kind,
        "mode": str(mode),
        "faults": len(listed),
        "vent": len(vents),
        "carry_on": len(listed) - len(vents),
        "slowest_vent_ms": 1e3 * max(fast) if fast else None,
        "wrong_outcomes": sum(not case.right for case in listed),
    }


def detail(case: Case) -> dict[str, Cell]:
    """Describe one case in full."""
    return {
        "device": case.kind,
        "fault": case.fault,
        "mode": str(case.mode),
        "must": str(case.wanted),
        "did": str(case.outcome),
        "vented_s": case.vented_s,
        "stayed": case.stayed,
        "recovered": case.recovered,
        "said": case.said,
    }
