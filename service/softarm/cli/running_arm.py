"""Options and connection of the commands that talk to a running arm."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import click

from softarm.common.errors import WorkFailedError
from softarm_client import Arm
from softarm_client.session import DEFAULT_ENDPOINT

Command = TypeVar("Command", bound=Callable[..., Any])


def arm_options(command: Command) -> Command:
    """Add ``--arm``, ``--endpoint`` and ``--zenoh``, passed as ``arm``, ``endpoint`` and ``zenoh_config``."""
    endpoint, path = "zenoh endpoint of its service.", click.Path(path_type=Path)
    for option in (
        click.option("--zenoh", "zenoh_config", type=path, help="JSON5 file with credentials."),
        click.option("--endpoint", default=DEFAULT_ENDPOINT, show_default=True, help=endpoint),
        click.option("--arm", required=True, help="Name of the arm."),
    ):
        command = option(command)
    return command


@contextmanager
def leased(arm: Arm) -> Iterator[None]:
    """Hold the lease of an arm within a block and disarm at its end, also after Ctrl-C.

    Raises:
        WorkFailedError: The lease was lost meanwhile; the service has vented the arm.
    """
    with arm.lease() as lease:
        try:
            yield
        finally:
            if not lease.lost.is_set() and arm.state().mode not in ("IDLE", "FAULTED"):
                arm.disarm()
    if lease.lost.is_set():
        raise WorkFailedError(f"{arm.keys.arm}: {lease.reason}; the arm is vented")


def require_mode(arm: Arm, mode: str) -> None:
    """Check that the arm is still in a mode.

    Raises:
        WorkFailedError: It has left it; the message names the cause.
    """
    state = arm.state()
    if state.mode != mode:
        cause = state.fault_cause or "see softarm status"
        raise WorkFailedError(f"{arm.keys.arm}: left {mode} for {state.mode}: {cause}")
