"""``softarm page``: the operator page in the browser."""

import signal
from functools import partial
from pathlib import Path

import click

from softarm.cli.output import say
from softarm.daemon.config import load_config
from softarm.daemon.settings import PageSettings
from softarm.daemon.unit import zenoh_credential
from softarm_client import Arm
from softarm_client.session import DEFAULT_ENDPOINT, NetworkSettings

ENDING = signal.SIGINT, signal.SIGTERM
AGAIN_S = 1.0
"""Pause before a service that did not answer is asked again."""


@click.command()
@click.option("--arm", help="Name of the arm.")
@click.option(
    "--config",
    "path",
    type=click.Path(path_type=Path),
    help="The service's TOML file, in place of the other options.",
)
@click.option("--endpoint", help=f"zenoh endpoint of its service.  [default: {DEFAULT_ENDPOINT}]")
@click.option("--host", help="Address to serve the page on.  [default: 127.0.0.1]")
@click.option("--port", type=int, help="Its TCP port.  [default: 8080]")
@click.option("--zenoh", "zenoh_config", type=click.Path(path_type=Path), help="JSON5 file with credentials.")
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
    endpoint: str | None,
    host: str | None,
    port: int | None,
    zenoh_config: Path | None,
    origins: tuple[str, ...],
) -> None:
    """Serve the operator page: 3-D view, forces, pressures, health, teach and stop buttons.

    Example: softarm page --arm sopra
    """
    from softarm.page.app import Page  # viser is heavy
    from softarm.page.server import page_server
    from softarm.page.waiting import wait_for_arm

    known = None if path is None else load_config(path).config
    arm = arm or (None if known is None else known.arm)
    if arm is None:
        raise click.UsageError("give --arm, or --config with the service's file")
    settings = PageSettings() if known is None else known.page
    endpoint = endpoint or (DEFAULT_ENDPOINT if known is None else _endpoint(known.network))
    zenoh_config = zenoh_config or zenoh_credential()
    host, port = host or settings.host, port or settings.port
    signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    connect = partial(Arm, arm, endpoint, "operator page", zenoh_config)
    with page_server(host, port, arm, origins) as server:
        click.echo(f"operator page: http://{host}:{port}")
        served = wait_for_arm(server, connect, say, lambda: signal.sigtimedwait(ENDING, AGAIN_S) is not None)
        if served is not None:
            with served.client, Page(served, server):
                signal.sigwait(ENDING)


def _endpoint(network: NetworkSettings) -> str:
    """Return where a service with these settings is reached."""
    ends = network.connect if network.mode == "client" else network.listen
    return next(iter(ends), DEFAULT_ENDPOINT)
