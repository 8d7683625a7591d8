"""``softarm bench soak``: a service for long, under faults and clients that come, go and stall."""

import shutil
import tempfile
from pathlib import Path

import click

from acceptance.soak_run import Soak, SoakSettings
from softarm.cli.output import PATH, json_option, progress, show
from softarm.common.tables import Cell, Table

NOTES = (
    "Fakes, service and clients are processes of their own, over zenoh. Lost replies: commands without an "
    "answer within their deadline. Growth: resident memory at the end over that after the first fifth.",
    "Clients come and go every few seconds, one of them stopped with SIGSTOP for two; a fault is injected "
    "into a device every five seconds; recordings are started and ended all the while and each "
    "is read again.",
    "Estimates on a model: those that converged on it. The rod answers while the finite elements have lost "
    "the arm.",
)
ALLOWED_GROWTH_PERCENT = 5.0


@click.command()
@click.option("--seconds", default=1800.0, show_default=True, help="How long.")
@click.option("--model", type=click.Choice(["fem", "rod"]), default="fem", show_default=True)
@click.option("--seed", default=1, show_default=True, help="Of faults and clients.")
@click.option("--out", type=PATH, help="Folder for logs and recordings; else only kept if the status is 1.")
@json_option
def command(seconds: float, model: str, seed: int, out: Path | None, as_json: bool) -> int:
    """Run a service at 100 Hz for long; count lost replies, overruns, and memory that grows.

    The exit status is 1 if a reply was lost, a recording cannot be read, memory grows by more than 5 %, or
    the service or its estimator ended.

    Example: softarm bench soak --seconds 60
    """
    folder = out or Path(tempfile.mkdtemp(prefix="softarm-soak-"))
    with progress("soak", seconds) as advance:
        found = Soak(SoakSettings(folder, seconds, model, seed), advance).run()
    sound = found.sound(ALLOWED_GROWTH_PERCENT)
    rows: list[dict[str, Cell]] = [{"what": name, "value": value} for name, value in found.figures.items()]
    show(Table(f"Soak of {seconds:g} s at 100 Hz, {model}", rows, NOTES), as_json=as_json)
    if not sound:
        click.echo(f"its logs are kept in {folder}", err=True)
    elif out is None:
        shutil.rmtree(folder)
    return 0 if sound else 1
