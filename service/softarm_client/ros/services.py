"""The commands behind the node's services, and the lease that the node holds for its callers."""

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from softarm_client.arm import Arm
from softarm_client.errors import ClientError
from softarm_client.lease import HeldLease
from softarm_client.results import Result

Do = Callable[[], Result | str]


class LeaseKeeper:
    """Holds the lease from ``acquire`` to ``release``, renewed meanwhile.

    Args:
        arm: Client of the arm.
        on_lost: Called with the reason when the lease is lost.
    """

    def __init__(self, arm: Arm, on_lost: Callable[[str], None]) -> None:
        self._arm = arm
        self._on_lost = on_lost
        self._held: HeldLease | None = None
        self._exit = ExitStack()

    def acquire(self) -> str:
        """Acquire the lease unless it is held.

        Raises:
            CommandRefusedError: Somebody else holds it, or the service does not answer.
        """
        if self._held is None or self._held.lost.is_set():
            self.release()
            self._held = self._exit.enter_context(self._arm.lease(on_lost=self._on_lost))
        return "the node holds the lease"

    def release(self) -> str:
        """Return the lease back if it is held."""
        self._exit.close()
        self._held = None
        return "the node does not hold the lease"


def verbs(arm: Arm, lease: LeaseKeeper, parameter: Callable[[str], Any]) -> dict[str, Do]:
    """Return what each service does.

    Args:
        arm: Client of the arm.
        lease: The node's lease.
        parameter: Returns a parameter's value.

    Returns:
        Name of the service to its command, but for ``teach/goto``.
    """
    return {
        "stop": arm.stop,
        "lease/acquire": lease.acquire,
        "lease/release": lease.release,
        "arm": arm.arm,
        "disarm": arm.disarm,
        "clear": arm.clear,
        "estimate/tare": arm.tare,
        "calibrate/rest": arm.align_at_rest,
        "teach/start": arm.teach.start,
        "teach/hold": lambda: arm.teach.hold(float(parameter("ramp_s"))),
        "teach/save": lambda: arm.teach.save(str(parameter("pose_name"))),
        "teach/release": arm.teach.release,
        "experiment/begin": arm.experiment.begin,
        "experiment/end": arm.experiment.end,
        "record/start": lambda: arm.recordings.start(str(parameter("recording_name"))),
        "record/stop": arm.recordings.stop,
    }


def answer(do: Do) -> tuple[bool, str]:
    """Carry out a command; return whether it was accepted, and its result as JSON or the refusal in words."""
    try:
        result = do()
    except ClientError as error:
        return False, str(error)
    return True, result if isinstance(result, str) else result.model_dump_json()
