"""Where the control loop meets the outside: instruments, the estimator's process, the network, the clocks."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from softarm.daemon.control.host_watch import HostLoad
from softarm.daemon.control.instruments import Instruments
from softarm.daemon.control.readings import Readings
from softarm.daemon.estimation.messages import EstimationRequest, EstimationResult
from softarm.daemon.estimation.worker import WorkerState
from softarm_client.messages import Message


class EstimatorProcess(Protocol):
    """What the loop needs of the process that estimates."""

    @property
    def state(self) -> WorkerState:
        """State of the process."""

    def submit(self, make: Callable[[], EstimationRequest | None]) -> None:
        """Make and send a request as soon as the process is free; it replaces one that still waits."""

    def watch(self) -> None:
        """Kill a process that is stuck; called at every tick."""


class MessageSink(Protocol):
    """Publishes the messages of the loop; it never blocks."""

    def publish(self, stream: str, message: Message) -> None:
        """Publish a message on a stream."""

    @property
    def shape_wanted(self) -> bool:
        """Whether anybody listens to the shape."""

    def publish_shape(self, nodes: bytes) -> None:
        """Publish x, y, z [m] and stress [Pa] of every node, little-endian float32."""


@dataclass(frozen=True)
class Clocks:
    """The clocks of the loop.

    Args:
        monotonic_ns: Monotonic clock.
        unix_ns: Wall clock.
    """

    monotonic_ns: Callable[[], int] = time.monotonic_ns
    unix_ns: Callable[[], int] = time.time_ns


@dataclass(frozen=True)
class LoopDependencies:
    """What a control loop runs on.

    Args:
        instruments: Builds the instruments, which feed their samples into the readings.
        estimator: Builds the estimator's process, which passes each result to the given function.
        sink: Publishes the streams.
        base_body: Channel of the pose of the base, empty for none.
        ready: Called once, as soon as the estimator has started or has given up.
        host: Returns the newest state of the host.
    """

    instruments: Callable[[Readings], Instruments]
    estimator: Callable[[Callable[[EstimationResult], None]], EstimatorProcess]
    sink: MessageSink
    base_body: str
    ready: Callable[[], None]
    clocks: Clocks = Clocks()
    host: Callable[[], HostLoad] = HostLoad
