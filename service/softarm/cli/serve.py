"""``softarm serve``: the daemon beside the arm."""

import asyncio
import logging
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from logging.handlers import QueueHandler, QueueListener
from pathlib import Path
from queue import SimpleQueue
from typing import TextIO

import click

from softarm.cli.output import PATH, NumberRange, progress
from softarm.common.errors import WorkFailedError
from softarm.common.rods import cache_directory, known_trusted_rod, trusted_rod
from softarm.daemon.app import Replay, Service
from softarm.daemon.config import Setup, load_config
from softarm.daemon.notify import Notifier
from softarm.daemon.unit import UNIT_FOLDERS
from softarm.estimator.errors import InputError
from softarm.estimator.files import require_writable
from softarm.estimator.specimen import Specimen
from softarm.recordings import load_recording
from softarm_client.errors import ClientError

logger = logging.getLogger(__name__)

STEP_S = 300.0
"""No step of fitting a rod takes longer; the service requests so much time of systemd with each."""
SWITCH_S = 2e-4
"""No other thread, such as that of the recorder, holds the interpreter's lock longer while the loop waits."""


@click.command()
@click.option("--config", "path", required=True, type=PATH, help="The service's TOML file.")
@click.option("--replay", type=PATH, help="Play this recording instead of the instruments.")
@click.option(
    "--speed",
    type=NumberRange(min=0.0, min_open=True),
    default=1.0,
    show_default=True,
    help="Speed of the replay; 2 is twice as fast as recorded.",
)
@click.option("--verbose", is_flag=True, help="Log every command and every attempt to connect as well.")
def command(path: Path, replay: Path | None, speed: float, verbose: bool) -> None:
    """Serve one arm: acquisition, estimation, safety and teach mode over zenoh.

    Example: softarm serve --config /etc/softarm/sopra.toml
    """
    with logged_off_loop(verbose):
        setup = _prepared(path)
        try:
            asyncio.run(_serve(setup, None if replay is None else Replay(load_recording(replay), speed)))
        except (InputError, ClientError, WorkFailedError):
            raise
        except Exception:
            logger.exception("the service ended by an internal error")
            raise


@contextmanager
def logged_off_loop(verbose: bool, stream: TextIO | None = None) -> Iterator[None]:
    """Write the log from a thread: a disk or a journal that accepts no line must not delay the control loop.

    Args:
        verbose: Whether to log every command and every attempt to connect as well.
        stream: Where to; standard error when left out.
    """
    at = "" if "JOURNAL_STREAM" in os.environ else "%(asctime)s "  # the journal has its own time
    writer = logging.StreamHandler(stream)
    writer.setFormatter(logging.Formatter(f"{at}%(levelname)s %(name)s: %(message)s"))
    lines: SimpleQueue[logging.LogRecord] = SimpleQueue()
    listener, entry, root = QueueListener(lines, writer), QueueHandler(lines), logging.getLogger()
    root.addHandler(entry)
    logging.getLogger("softarm").setLevel(logging.DEBUG if verbose else logging.INFO)
    listener.start()
    try:
        yield
    finally:
        root.removeHandler(entry)
        listener.stop()


def _prepared(path: Path) -> Setup:
    """Load the configuration, check its folders, and fit its rod where none is stored yet.

    Raises:
        InputError: A folder cannot be written.
        WorkFailedError: The rod is too far from the finite elements to stand in for them, or cannot be kept
            for the estimator's process.
    """
    setup = load_config(path)
    for name in UNIT_FOLDERS:
        require_writable(f"{path}, {name}", getattr(setup.config, name))
    if setup.config.control.model == "rod":
        _fit_rod(setup.specimen)
    return setup


def _fit_rod(specimen: Specimen) -> None:
    notifier = Notifier.from_environment()
    with progress(f"fitting the rod of {specimen.name}") as advance:

        def step(*_: object) -> None:
            notifier.extend(STEP_S)
            advance(1)

        trusted_rod(specimen, step)
    notifier.close()
    if known_trusted_rod(specimen) is None:
        raise WorkFailedError(
            f"{cache_directory()}: the rod that was fitted cannot be kept there; make it writable, or set "
            "XDG_CACHE_HOME to a folder that is"
        )


async def _serve(setup: Setup, replay: Replay | None) -> None:
    sys.setswitchinterval(SWITCH_S)
    notifier = Notifier.from_environment()
    service = Service(setup, notifier, replay)
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, service.stop)
    try:
        await service.run()
    finally:
        notifier.close()
