"""``softarm page``: the operator page in the browser."""

import signal
from pathlib import Path

import click

from softarm.client.client import SoftarmClient
from softarm.client.session import DEFAULT_ENDPOINT


@click.command()
@click.option("--arm", required=True, help="Name of the arm.")
@click.option(
    "--endpoint", default=DEFAULT_ENDPOINT, show_default=True, help="zenoh endpoint of its service."
)
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to serve the page on.")
@click.option("--port", default=8080, show_default=True, help="Its TCP port.")
@click.option("--zenoh", "zenoh_config", type=click.Path(path_type=Path), help="JSON5 file with credentials.")
@click.option(
    "--origin",
    "origins",
    multiple=True,
    metavar="URL",
    help="Further address by which browsers reach the page, such as that of a proxy; may be repeated.",
)
def command(
    arm: str, endpoint: str, host: str, port: int, zenoh_config: Path | None, origins: tuple[str, ...]
) -> None:
    """Serve the operator page: 3-D view, forces, pressures, health, teach and stop buttons.

    Example: softarm page --arm sopra
    """
    from softarm.page.app import Page  # viser and the meshing are heavy

    signal.pthread_sigmask(signal.SIG_BLOCK, (signal.SIGINT, signal.SIGTERM))
    with (
        SoftarmClient(arm, endpoint, "operator page", zenoh_config) as client,
        Page(client, host, port, origins) as page,
    ):
        click.echo(f"operator page: http://{host}:{page.port}")
        signal.sigwait((signal.SIGINT, signal.SIGTERM))
