"""``softarm record``: a recording of a running arm."""

import signal
from pathlib import Path

import click

from softarm.cli.output import json_option, notify, progress, show
from softarm.cli.running_arm import arm_options, file_name, seconds_option
from softarm.cli.signals import ENDING, awaiting_signals
from softarm.common.errors import WorkFailedError
from softarm.common.tables import Table
from softarm_client import Arm

POLL_S = 0.5


@click.command()
@arm_options
@click.option(
    "--name",
    type=file_name,
    default="recording",
    show_default=True,
    help="Name of the file, without suffix.",
)
@seconds_option("Length of the recording")
@click.option("--start", is_flag=True, help="Start a recording and return.")
@click.option("--stop", is_flag=True, help="End the running recording and return.")
@json_option
def command(
    arm: str,
    endpoint: str,
    name: str,
    seconds: float | None,
    zenoh_config: Path | None,
    start: bool,
    stop: bool,
    as_json: bool,
) -> None:
    """Record every stream of a running arm, on the service's host; Ctrl-C or --seconds ends it.

    The command does not move the arm and needs no lease. The service writes the file, so it stays complete
    if this command is killed; the recording then ends with --stop or with the service.

    Example: softarm record --arm sopra --seconds 60 --name pull
    """
    if start + stop + (seconds is not None) > 1:
        raise click.UsageError("give only one of --seconds, --start and --stop")
    with (
        awaiting_signals(),
        Arm(arm, endpoint, name="softarm record", zenoh_config=zenoh_config) as client,
    ):
        if not stop:
            path = client.recordings.start(name).path
            notify(f"recording to {path}")
        if start:
            show(Table("Recording", [{"file": path, "dropped": 0}]), as_json=as_json)
            return
        if not stop:
            _wait(client, seconds)
        ended = client.recordings.stop()
    show(Table("Recording", [{"file": ended.path, "dropped": ended.dropped}]), as_json=as_json)


def _wait(client: Arm, seconds: float | None) -> None:
    """Wait for the end, a signal, or the service's own end of the recording."""
    left_s = seconds if seconds is not None else float("inf")
    with progress("recording", seconds) as advance:
        while left_s > 0.0:
            step_s = min(POLL_S, left_s)
            if signal.sigtimedwait(ENDING, step_s) is not None:
                return
            left_s -= step_s
            advance(step_s)
            try:
                if client.state().recording is None:
                    return
            except TimeoutError as error:
                if not client.alive():
                    raise WorkFailedError(
                        f"{client.keys.arm}: the service has ended; see its recording directory"
                    ) from error
