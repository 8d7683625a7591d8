"""Options and connection of the commands that talk to a running arm."""

import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import click

from softarm.cli.output import PATH, NumberRange
from softarm.common.errors import WorkFailedError
from softarm_client import Arm
from softarm_client.commands import FILE_NAME, LONGEST_NAME
from softarm_client.session import DEFAULT_ENDPOINT

Command = TypeVar("Command", bound=Callable[..., Any])
STEP_S = 0.25


def arm_options(command: Command) -> Command:
    """Add ``--arm``, ``--endpoint`` and ``--zenoh``, passed as ``arm``, ``endpoint`` and ``zenoh_config``."""
    endpoint = "zenoh endpoint of its service."
    for option in (
        click.option("--zenoh", "zenoh_config", type=PATH, help="JSON5 file with credentials."),
        click.option("--endpoint", default=DEFAULT_ENDPOINT, show_default=True, help=endpoint),
        click.option("--arm", required=True, help="Name of the arm."),
    ):
        command = option(command)
    return command


def file_name(value: str) -> str:
    """Return the name of a pose or of a recording, as the type of an option or argument.

    Raises:
        BadParameter: The service would refuse it.
    """
    if len(value) > LONGEST_NAME or not re.match(FILE_NAME, value):
        raise click.BadParameter(f"{value!r}: use 1 to {LONGEST_NAME} letters, digits and any of _.-")
    return value


def seconds_option(what: str) -> Callable[[Command], Command]:
    """Add ``--seconds``, passed as ``seconds``: how long something lasts."""
    duration = NumberRange(min=0.0, min_open=True)
    return click.option("--seconds", type=duration, help=f"{what}; by default until Ctrl-C.")


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


def hold(arm: Arm, mode: str, seconds: float | None, renew: Callable[[], None] = lambda: None) -> None:
    """Wait for a while, and check that the arm stays in a mode.

    Args:
        arm: The running arm.
        mode: Mode that it is to stay in.
        seconds: How long; ``None`` for ever.
        renew: Called four times a second.

    Raises:
        WorkFailedError: The arm has left the mode.
    """
    end = time.monotonic() + (float("inf") if seconds is None else seconds)
    while (left := end - time.monotonic()) > 0.0:
        renew()
        threading.Event().wait(min(left, STEP_S))
        require_mode(arm, mode)


def require_mode(arm: Arm, mode: str) -> None:
    """Check that the arm is still in a mode.

    Raises:
        WorkFailedError: It has left it; the message names the cause.
    """
    state = arm.state()
    if state.mode != mode:
        cause = state.fault_cause or "see softarm status"
        raise WorkFailedError(f"{arm.keys.arm}: left {mode} for {state.mode}: {cause}")
