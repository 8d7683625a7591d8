"""One experiment on one arm: connection, lease, recording."""

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from softarm.estimator.errors import InputError
from softarm.experiments.rig import FakeRig
from softarm_client import Arm
from softarm_client.errors import CommandRefusedError, UnreachableError
from softarm_client.messages import State

logger = logging.getLogger(__name__)
READY_S = 90.0
"""For valves that answer and a first estimate, once the estimator has been built."""
SILENT_S = 30.0
"""A service that publishes no state for so long while it builds the estimator has ended or stands still."""
PROGRESS_S = 15.0


def wait_built(client: Arm, silent_s: float = SILENT_S, progress_s: float = PROGRESS_S) -> None:
    """Wait until the service has left STARTING, however long it builds its estimator.

    The service bounds this itself: it ends an estimator that is built for too long, and stops after
    some attempts. In a fresh installation the kernels are compiled, which takes minutes on a busy machine.

    Args:
        client: Client of the service.
        silent_s: How long the service may publish no state [s].
        progress_s: Time between two lines of progress in the log [s].

    Raises:
        InputError: The service no longer publishes its state.
    """
    built, began_s = threading.Event(), time.monotonic()
    heard_s = [began_s]

    def on_state(state: State) -> None:
        heard_s[0] = time.monotonic()
        if state.mode != "STARTING":
            built.set()

    with client.states().subscribe(on_state):
        reported_s = began_s
        while not built.wait(min(1.0, silent_s, progress_s)):
            now_s = time.monotonic()
            if now_s - heard_s[0] > silent_s:
                what = f"published no state for {silent_s:g} s while its estimator was being built"
                raise InputError(client.keys.arm, what, "see the service's log")
            if now_s - reported_s > progress_s:
                reported_s = now_s
                words = "%s: the estimator is being built (%.0f s so far; the first time takes minutes)"
                logger.warning(words, client.keys.arm, now_s - began_s)


def wait_ready(client: Arm) -> State:
    """Wait until the service is up, its valves answer and it publishes estimates.

    Raises:
        InputError: It is not ready in time; its findings state why.
    """
    wait_built(client)
    try:
        state = client.states().wait_for(
            lambda s: s.mode != "STARTING" and None not in s.measured_pa, READY_S
        )
        client.estimates().wait_for(lambda e: e.status in ("converged", "degraded"), READY_S)
    except TimeoutError as error:
        raise InputError(client.keys.arm, f"is not ready ({error})", "see the service's log") from error
    return state


def connect(rig: FakeRig) -> Arm:
    """Connect to a rig's service, however long it takes to open its port.

    Raises:
        InputError: The service ended.
        UnreachableError: It does not listen in time.
    """
    last: UnreachableError | None = None
    for _ in range(30):
        if rig.service.process.poll() is not None:
            lines = (rig.folder / "service.log").read_text().strip().splitlines()[-1:]
            raise InputError("softarm serve", f"ended ({' '.join(lines)})", f"see {rig.folder}")
        try:
            return Arm(rig.settings.arm, rig.settings.endpoint, name="experiment")
        except UnreachableError as error:  # zenoh itself waits three seconds for the port
            last = error
    assert last is not None
    raise last


@contextmanager
def recorded(client: Arm, name: str) -> Iterator[list[str]]:
    """Record the block; the list then holds the file's path."""
    paths: list[str] = []
    client.recordings.start(name)
    try:
        yield paths
    finally:
        try:
            paths.append(client.recordings.stop().path)
        except CommandRefusedError as refusal:
            paths.append(f"not written: {refusal}")
