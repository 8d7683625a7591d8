"""``softarm bench safety``: every fault of every device in every mode, and where it leaves the arm."""

import logging
from collections.abc import Iterable, Sequence

import click

from service.bench import safety_run
from service.bench.safety_cases import FAST_S, Outcome
from service.bench.safety_run import BENCHES, Case, count, run
from service.cli.output import Cell, Table, json_option, progress, quick_option, show

NOTES = (
    "Real fakes, drivers, guard, controller and commands in one process and accelerated time; the estimator "
    "is stood in for. Vented: the terminal holds zeros for every valve.",
    f"Aim: within {FAST_S:g} s of the fault; a pressure that is not reached counts after 1.7 s. "
    "Nothing arms by itself, and every device is well again afterwards.",
    "A slot of festo_vtem keeps an error until the operator's clear acknowledges it.",
)


@click.command()
@json_option
@quick_option
def command(as_json: bool, quick: bool) -> int:
    """Strike every device with each of its faults in every mode; tell where that left the arm.

    The status is 1 when a fault left the arm elsewhere than stated, or too late.

    Example: softarm bench safety --quick
    """
    choose = safety_run.quick if quick else safety_run.everything
    benches = BENCHES[:1] if quick else BENCHES
    logging.disable(logging.WARNING)
    with progress("faults", count(benches, choose)) as advance:
        cases = run(benches, choose, lambda: advance(1))
    wrong = [case for case in cases if not case.right]
    tables = [Table("Faults of every device in every mode", summary(cases), NOTES)]
    if wrong:
        tables.append(Table("Not as stated", [detail(case) for case in wrong]))
    show(*tables, as_json=as_json)
    return 1 if wrong else 0


def summary(cases: Sequence[Case]) -> list[dict[str, Cell]]:
    """Sum up the cases of each kind of device in each mode."""
    keys = dict.fromkeys((case.kind, case.mode) for case in cases)
    return [_row(kind, mode, [c for c in cases if (c.kind, c.mode) == (kind, mode)]) for kind, mode in keys]


def _row(kind: str, mode: str, cases: Iterable[Case]) -> dict[str, Cell]:
    listed = list(cases)
    vents = [case for case in listed if case.outcome is Outcome.VENTS]
    fast = [case.vented_s for case in vents if case.within_s == FAST_S and case.vented_s is not None]
    return {
        "device": kind,
        "mode": str(mode),
        "faults": len(listed),
        "vent": len(vents),
        "carry_on": len(listed) - len(vents),
        "slowest_vent_ms": 1e3 * max(fast) if fast else None,
        "not_as_stated": sum(not case.right for case in listed),
    }


def detail(case: Case) -> dict[str, Cell]:
    """Tell one case in full."""
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
