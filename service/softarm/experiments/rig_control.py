"""What an experiment acts through: the arm's client, and the control port where the instruments are fakes."""

import json
import socket
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Self

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.rotations import from_quaternions
from softarm_client import Arm


class FakeControl:
    """The control port of running fakes: one JSON object a line.

    Args:
        address: ``host:port`` as the fakes announced it.

    Raises:
        InputError: Nothing answers there.
    """

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        try:
            self._socket = socket.create_connection((host, int(port)), timeout=5.0)
        except OSError as error:
            reason = error.strerror or str(error)
            raise InputError(f"fakes at {address}", f"no answer ({reason})", "start softarm fakes") from error
        self._file = self._socket.makefile("rwb")

    def ask(self, do: str, **fields: object) -> dict[str, Any]:
        """Send a request and return the reply.

        Raises:
            InputError: The fakes refused it.
        """
        self._file.write(json.dumps({"do": do, **fields}).encode() + b"\n")
        self._file.flush()
        reply: dict[str, Any] = json.loads(self._file.readline())
        if not reply.get("ok"):
            raise InputError("fakes", str(reply.get("error")), "see docs/fakes.md")
        return reply

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
        self._socket.close()


def laboratory_of(control: FakeControl) -> Callable[[Floats], Floats]:
    """Return the map from the base frame of the fake arm to its laboratory."""
    truth = control.ask("truth")
    origin, rotation = np.array(truth["positions"][0]), from_quaternions(np.array(truth["quaternions"][0]))
    return lambda point: point @ rotation.T + origin


def ramp_pressures(client: Arm, start: Sequence[float], goal: Sequence[float], duration_s: float) -> None:
    """Lead the pressures along a straight line, renewing the set-point ten times a second.

    Args:
        client: The arm's client, with the lease.
        start: Pressures at the beginning [Pa].
        goal: Pressures at the end [Pa].
        duration_s: Duration of the ramp.
    """
    begin = time.monotonic()
    pause = threading.Event()
    while True:
        share = min((time.monotonic() - begin) / duration_s, 1.0) if duration_s > 0.0 else 1.0
        wanted = (1.0 - share) * np.array(start) + share * np.array(goal)
        client.pressures.set(wanted.tolist(), lifetime_s=5.0)
        if share >= 1.0:
            return
        pause.wait(0.1)
