"""What an experiment acts through: the arm's client, and the control port where the instruments are fakes."""

import json
import socket
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError
from softarm.estimator.rotations import from_quaternions
from softarm_client import Arm
from softarm_client.messages import Estimate, State


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
        """Send a request and give the reply.

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


@dataclass(frozen=True)
class MeanEstimate:
    """Means over a stretch of time.

    Args:
        gauge_n: Pull on the gauge, NaN when it was silent.
        force_n: Estimated force on the section in the base frame, shape (3,).
        covariance_n2: Its covariance at the end, shape (3, 3).
        position_m: Estimated position of the section, shape (3,).
        measured_pa: Measured pressures, shape (chambers,).
    """

    gauge_n: float
    force_n: Floats
    covariance_n2: Floats
    position_m: Floats
    measured_pa: Floats


class Collector:
    """Collects the streams while an experiment looks.

    Args:
        client: The arm's client.
        section: Section whose force is looked at.
    """

    def __init__(self, client: Arm, section: str) -> None:
        self._client = client
        self._section = section

    def observe(self, duration_s: float) -> MeanEstimate:
        """Average the streams over a duration.

        Raises:
            InputError: No estimate came.
        """
        states: list[State] = []
        estimates: list[Estimate] = []
        arm = self._client
        with arm.states().subscribe(states.append), arm.estimates().subscribe(estimates.append):
            threading.Event().wait(duration_s)
        if not estimates or not states:
            raise InputError(self._client.keys.arm, "no estimates are published", "see its findings")
        loads = [load for e in estimates for load in e.loads if load.section == self._section]
        if not loads:
            raise InputError(self._section, "no force is estimated there", "name another section")
        gauges = [state.gauges_n.get(self._section) for state in states]
        pulls = [pull for pull in gauges if pull is not None]
        pressures = [state.measured_pa for state in states]
        return MeanEstimate(
            float(np.mean(pulls)) if pulls else float("nan"),
            np.mean([load.force_n for load in loads], axis=0),
            np.array(loads[-1].covariance_n2, dtype=float),
            _position(states[-1], self._section),
            np.nanmean(np.array(pressures, dtype=float), axis=0),
        )


def _position(state: State, section: str) -> Floats:
    for pose in state.sections:
        if pose.section == section:
            return np.array(pose.position_m)
    return np.full(3, np.nan)


def ramp_pressures(client: Arm, start: Sequence[float], goal: Sequence[float], duration_s: float) -> None:
    """Lead the pressures along a straight line, renewing the set-point ten times a second.

    Args:
        client: The arm's client, with the lease.
        start: Pressures at the beginning [Pa].
        goal: Pressures at the end [Pa].
        duration_s: How long it takes.
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
