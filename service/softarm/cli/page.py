"""``softarm page``: the operator page in the browser."""

import signal
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from softarm.cli.output import PATH, PORT, notify, specimen_option
from softarm.cli.signals import ENDING, awaiting_signals
from softarm.daemon.config import load_config
from softarm.daemon.settings import PageSettings
from softarm.daemon.unit import zenoh_credential
from softarm_client import Arm
from softarm_client.messages import Surface
from softarm_client.session import DEFAULT_ENDPOINT, NetworkSettings

if TYPE_CHECKING:
    from softarm.estimator.specimen import Specimen

AGAIN_S = 1.0
"""Pause before the next request to a service that did not answer."""


@click.command()
@click.option("--arm", help="Name of the arm.")
@click.option("--config", "path", type=PATH, help="The service's TOML file, in place of the other options.")
@click.option(
    "--recording",
    type=PATH,
    help="Show this recording in place of a running arm: one that the service made, or the --out of softarm "
    "estimate.",
)
@click.option(
    "--diagnosis",
    type=PATH,
    metavar="FOLDER",
    help="Show this diagnosis in place of a running arm: the --out of softarm diagnose.",
)
@specimen_option
@click.option("--endpoint", help=f"zenoh endpoint of its service.  [default: {DEFAULT_ENDPOINT}]")
@click.option("--host", help="Address to serve the page on.  [default: 127.0.0.1]")
@click.option("--port", type=PORT, help="Its TCP port.  [default: 8080]")
@click.option("--zenoh", "zenoh_config", type=PATH, help="JSON5 file with credentials.")
@click.option(
    "--origin",
    "origins",
    multiple=True,
    metavar="URL",
    help="Further address by which browsers reach the page, such as that of a proxy; may be repeated.",
)
def command(
    arm: str | None,
    path: Path | None,
    recording: Path | None,
    diagnosis: Path | None,
    specimen: str | None,
    endpoint: str | None,
    host: str | None,
    port: int | None,
    zenoh_config: Path | None,
    origins: tuple[str, ...],
) -> None:
    """Serve the operator page: 3-D view, forces, pressures, health, teach and stop buttons.

    With --recording, the page shows a recording with estimates at the time of a slider. With --diagnosis, it
    shows what a diagnosis found, where on the arm, and the mismatch without and with it.

    Example: softarm page --arm sopra

    Example: softarm page --recording recordings/pull.mcap

    Example: softarm page --diagnosis report
    """
    from softarm.page.app import Page  # viser is heavy
    from softarm.page.server import page_server
    from softarm.page.waiting import wait_for_arm

    known = None if path is None else load_config(path).config
    settings = PageSettings() if known is None else known.page
    host, port = host or settings.host, port or settings.port
    if specimen is not None and recording is None:
        raise click.UsageError("--specimen is for --recording alone")
    if recording is not None or diagnosis is not None:
        if arm is not None or path is not None or None not in (recording, diagnosis):
            raise click.UsageError("give either --recording, or --diagnosis, or --arm or --config")
        if recording is not None:
            _show_recording(recording, specimen, host, port, origins)
        if diagnosis is not None:
            _show_diagnosis(diagnosis, host, port, origins)
        return
    arm = arm or (None if known is None else known.arm)
    if arm is None:
        raise click.UsageError("give --arm, --config with the service's file, --recording or --diagnosis")
    endpoint = endpoint or (DEFAULT_ENDPOINT if known is None else _endpoint(known.network))
    zenoh_config = zenoh_config or zenoh_credential()
    connect = partial(Arm, arm, endpoint, "operator page", zenoh_config=zenoh_config)
    with awaiting_signals(), page_server(host, port, arm, origins) as server:
        click.echo(f"operator page: http://{host}:{port}")
        served = wait_for_arm(
            server, connect, notify, lambda: signal.sigtimedwait(ENDING, AGAIN_S) is not None
        )
        if served is not None:
            with served.client, Page(served, server):
                signal.sigwait(ENDING)


def _show_recording(path: Path, specimen: str | None, host: str, port: int, origins: tuple[str, ...]) -> None:
    """Serve the page of a recording until a signal ends it."""
    from softarm.analysis.offline.inputs import specimen_of
    from softarm.page.recording import RecordingPage
    from softarm.page.server import page_server
    from softarm.recordings import load_events, load_recording

    loaded = load_recording(path)
    robot = specimen_of(specimen, [path], [loaded])
    surface = _surface(robot)
    with (
        awaiting_signals(),
        page_server(host, port, loaded.name, origins) as server,
        RecordingPage(loaded, robot, surface, server, load_events(path)),
    ):
        click.echo(f"page of {loaded.name}: http://{host}:{port}")
        signal.sigwait(ENDING)


def _show_diagnosis(folder: Path, host: str, port: int, origins: tuple[str, ...]) -> None:
    """Serve the page of a diagnosis until a signal ends it."""
    from softarm.analysis.diagnosis.motion import load_motions, specimen_file
    from softarm.analysis.diagnosis.report import read_report
    from softarm.estimator.specimen import load_specimen
    from softarm.page.diagnosis import DiagnosisPage
    from softarm.page.server import page_server

    report = read_report(folder)
    recordings = load_motions(folder, report.recordings)
    robot = load_specimen(specimen_file(folder))
    surface = _surface(robot)
    with (
        awaiting_signals(),
        page_server(host, port, folder.resolve().name, origins) as server,
        DiagnosisPage(report, recordings, robot, surface, server),
    ):
        click.echo(f"page of {folder}: http://{host}:{port}")
        signal.sigwait(ENDING)


def _surface(specimen: "Specimen") -> Surface:
    """Return the surface of an arm, as its page draws it."""
    from softarm.daemon.surface import drawn_surface
    from softarm.estimator.geometry import build_mesh

    mesh = build_mesh(specimen)
    return drawn_surface(mesh).message(mesh)


def _endpoint(network: NetworkSettings) -> str:
    """Return where a service with these settings is reached."""
    ends = network.connect if network.mode == "client" else network.listen
    return next(iter(ends), DEFAULT_ENDPOINT)
