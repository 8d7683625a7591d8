"""``softarm bench plant``: how much faster than real time the fake arm runs on one core."""

import json
import subprocess
import sys

import click

from softarm.cli.output import json_option, progress, quick_option, show
from softarm.common.tables import Table


@click.command()
@json_option
@quick_option
def command(as_json: bool, quick: bool) -> None:
    r"""Time the fake arm on one core.

    \b
    Example: softarm bench plant --quick
    """
    arguments = [sys.executable, "-m", "softarm.fakes.plant.speed", "4" if quick else "30"]
    with progress("running the fake arm"):
        done = subprocess.run(arguments, capture_output=True, text=True, check=False)
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:] or ["no message"]
        raise click.ClickException(f"the fake arm stopped: {last[0]}")
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    show(
        Table(
            "Fake arm", rows, ("Real-time factor: seconds of motion per second of processor time, aim 5.",)
        ),
        as_json=as_json,
    )
