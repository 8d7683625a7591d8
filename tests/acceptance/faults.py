"""``softarm bench faults``: every kind of device at once under random faults, against the truth."""

import logging

import click

from acceptance import fault_run
from softarm.cli.output import json_option, progress, quick_option, show
from softarm.common.tables import Table

MINUTES = 10.0
QUICK_MINUTES = 1.0 / 3.0


@click.command()
@click.option("--minutes", type=float, help="How long, in virtual time; 10 when left out, 20 s with --quick.")
@click.option("--seed", default=1, show_default=True, help="Seed of fakes and faults.")
@click.option(
    "--speed", default=40.0, show_default=True, help="Virtual seconds per second of waiting, at most."
)
@quick_option
@json_option
def command(minutes: float | None, seed: int, speed: float, quick: bool, as_json: bool) -> int:
    """Inject random faults into all kinds of fake devices at once, in accelerated time.

    The benchmark compares every valid reading with the truth at its own time: a value under a wrong name, or
    an old value with a new time, counts as mislabelled. The exit status is 1 if a reading is mislabelled, a
    task leaked, a fault that can be noticed was not, or a device did not recover in time.

    Example: softarm bench faults --quick
    """
    minutes = minutes or (QUICK_MINUTES if quick else MINUTES)
    logging.getLogger("softarm.drivers").setLevel(logging.CRITICAL)
    with progress("devices under random faults"):
        result = fault_run.run(60.0 * minutes, seed, speed)
    notes = (
        f"{result.virtual_s:.0f} s of virtual time in {result.seconds:.0f} s, seed {seed}; tasks leaked: "
        f"{len(result.leaked)}; errors that ended in the event loop: {len(result.stray)}.",
        "Checked: valid readings held against the truth, but for times when nothing betrays a fault.",
        *(example for outcome in result.outcomes.values() for example in outcome.examples),
    )
    show(Table("Devices under random faults", fault_run.rows(result), notes), as_json=as_json)
    return int(not result.sound)
