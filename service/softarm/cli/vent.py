"""``softarm vent``: zeros to the valves, whether or not the service runs."""

import asyncio
from pathlib import Path

import click

from softarm.cli.output import PATH, notify
from softarm.common.errors import WorkFailedError
from softarm.daemon.config import load_config
from softarm.drivers.device import close_all, connect_all
from softarm.drivers.errors import DeviceErrors
from softarm.drivers.valves import ValveBank


@click.command()
@click.option("--config", "path", required=True, type=PATH, help="The service's TOML file.")
def command(path: Path) -> None:
    """Vent every chamber; systemd runs this after the service has ended, also after a crash.

    Example: softarm vent --config /etc/softarm/sopra.toml
    """
    asyncio.run(_vent(path))


async def _vent(path: Path) -> None:
    setup = load_config(path)
    valves = [d for d in (entry.build() for entry in setup.devices) if isinstance(d, ValveBank)]
    try:
        await connect_all(valves)
    except DeviceErrors as errors:
        raise WorkFailedError("; ".join(errors.lines())) from errors
    finally:
        await close_all(valves)  # closing writes zeros
    notify(f"vented: {', '.join(bank.name for bank in valves)}")
