"""Starts the node: finds ROS 2, waits for the arm's service, and ends on a signal."""

import os
import signal
import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from softarm_client.arm import Arm
from softarm_client.errors import SetupError, UnreachableError

ENDING = signal.SIGINT, signal.SIGTERM
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
"""Environment variable of ROS 2 for how far nodes find each other; its own default is the whole network."""
AGAIN_S = 1.0
"""Pause before a service that did not answer is asked again."""
POLL_S = 0.2
"""A signal that a thread of zenoh or ROS 2 takes does not wake the main thread: it looks so often."""
CURE = "source its setup.bash, or pip install softarm-client[ros] in a new environment; see docs/ros.md"


def serve(
    arm: str,
    endpoint: str,
    zenoh_config: Path | None,
    arguments: Sequence[str],
    notify: Callable[[str], None],
) -> None:
    """Run the node of an arm until SIGINT or SIGTERM.

    ROS 2 asks nobody for credentials: unless the environment says otherwise, only this host sees the node.

    Args:
        arm: The arm's name.
        endpoint: Where its service, or a router before it, listens.
        zenoh_config: JSON5 file with credentials and certificates.
        arguments: Arguments of ROS 2, from ``--ros-args`` on.
        notify: Takes what is waited for, once for each reason, and the name of the node.

    Raises:
        SetupError: ROS 2 is not there or does not take the arguments, or the file is not valid.
    """
    if arguments and arguments[0] != "--ros-args":
        raise SetupError("arguments", f"{arguments[0]!r} is unknown", "arguments of ROS 2 follow --ros-args")
    os.environ.setdefault(RANGE, "LOCALHOST")
    try:
        from softarm_client.ros.node import running_node
    except ImportError as error:
        raise SetupError("ROS 2", f"cannot be imported ({error})", CURE) from error
    ended = _ended_by_signal()
    client = _wait_for(partial(Arm, arm, endpoint, "ROS node", zenoh_config=zenoh_config), notify, ended)
    if client is None:
        return
    with client, running_node(client, arguments) as node:
        notify(f"ROS 2 node {node.name}; {RANGE}={os.environ[RANGE]}")
        while not ended.wait(POLL_S):
            pass


def _ended_by_signal() -> threading.Event:
    """Take the signals that end a process from here on; the event says that one came."""
    ended = threading.Event()
    for number in ENDING:
        signal.signal(number, lambda *_: ended.set())
    return ended


def _wait_for(
    connect: Callable[[], Arm], notify: Callable[[str], None], ended: threading.Event
) -> Arm | None:
    """Connect to the arm's service as soon as it is there; ``None`` where the wait was ended."""
    reported = ""
    while True:
        try:
            return connect()
        except UnreachableError as error:
            if str(error) != reported:
                reported = str(error)
                notify(f"waiting for the service: {reported}")
        if ended.wait(AGAIN_S):
            return None
